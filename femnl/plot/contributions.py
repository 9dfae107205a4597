"""What each named cause changes along the data, and what remains underneath."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from femnl.core.comparison import Comparison, Curve, Curves, Images
from femnl.core.contributions import contributed
from femnl.optics.harmonics import signal_phase
from femnl.plot.comparison import (
    EXCLUDED,
    FAINTEST,
    WIDE,
    Across,
    axis_across,
    bar_of_sigma,
    name_row,
    name_ticks,
    paint,
    residual_axis,
    ring_excluded,
)
from femnl.plot.style import (
    COLOURS,
    INK,
    as_written,
    axis_label,
    new_figure,
    prefixed,
    scale_bar,
    style,
    symmetric_limit,
)

Array = NDArray[np.float64]
ALL = "deviation"
TOGETHER = "interaction"
LEFT = "remainder (σ)"


def contributions_figure(comparison: Comparison) -> Figure:
    """Draw what each cause changes of the data, their interaction, and what remains.

    Args: comparison: models with all causes, with none, and without each of the causes, whose names
        are those of the models from the third on.
    Returns: the Figure. The interaction is drawn where it exceeds the noise anywhere.
    """
    with style():
        return _images(comparison) if isinstance(comparison, Images) else _curves(comparison)


def _curves(found: Curves) -> Figure:
    """Draw terms in one panel where there is one curve, in a panel each where there are several."""
    names = found.models[2:]
    terms = [_terms(curve, names) for curve in found.curves]
    shown = [ALL, *names]
    if any(_interacts(own[TOGETHER], c.sd) for c, own in zip(found.curves, terms, strict=True)):
        shown.append(TOGETHER)
    across = axis_across(found)
    every = np.concatenate([own[name] for own in terms for name in shown])
    scale, unit = prefixed(every, found.y_unit)
    single = len(found.curves) == 1
    heights = [2.2, 1.0] if single else [1.0] * (len(shown) + 1)
    figure = new_figure(WIDE, 1.3 * sum(heights) + 0.5)
    ratios = {"height_ratios": heights}
    panels = figure.subplots(len(heights), 1, sharex=True, gridspec_kw=ratios)
    if single:
        _one_curve(panels[0], found, {name: terms[0][name] / scale for name in shown}, across)
        panels[0].set_ylabel(axis_label(f"change of {found.y}", unit))
    else:
        limit = 1.08 * float(np.nanmax(np.abs(every))) / scale or 1.0
        for axes, name in zip(panels[:-1], shown, strict=True):
            measured = name == ALL
            _one_term(axes, found, [own[name] / scale for own in terms], across, measured)
            axes.set_title(name, fontsize=8)
            axes.set_ylabel(unit, fontsize=8)
            axes.set_ylim(-limit, limit)
    _remainder(panels[-1], found, across)
    panels[-1].set_xlabel(axis_label(across.name, across.unit))
    if found.ticks:
        name_ticks(panels[-1], found.ticks)
    if 1 < len(found.curves) <= len(COLOURS):
        handles = panels[-1].get_legend_handles_labels()
        figure.legend(*handles, loc="outside lower center", ncols=4)
    return figure


def _terms(curve: Curve, names: tuple[str, ...]) -> dict[str, Array]:
    """Return the deviation from the idle model, each contribution, and the interaction."""
    causes, together = contributed(curve.predictions)
    deviation = curve.data - curve.predictions[1]
    return {ALL: deviation, **dict(zip(names, causes, strict=True)), TOGETHER: together}


def _interacts(together: NDArray[np.generic], sd: Array | float) -> bool:
    """Whether causes interact by more than noise somewhere; less could not be seen in the data."""
    sigmas = np.abs(together) / sd
    return bool(np.any(sigmas[np.isfinite(sigmas)] > 1))


def _one_curve(axes: Axes, found: Curves, terms: dict[str, Array], across: Across) -> None:
    """Draw all terms of one curve: causes as bars where x only counts, else as lines."""
    (curve,) = found.curves
    x = across.place(curve.x)
    lines = {name: values for name, values in terms.items() if name != ALL}
    width = 0.8 / len(lines)
    for k, (name, values) in enumerate(lines.items()):
        colour = INK if name == TOGETHER else COLOURS[k % len(COLOURS)]
        if found.joined:
            axes.plot(x, values, "--" if name == TOGETHER else "-", color=colour, label=name)
        else:
            place = x + (k - (len(lines) - 1) / 2) * width
            axes.bar(place, values, width, color=colour, alpha=0.75, label=name)
    axes.plot(x, terms[ALL], ".", color=INK, markersize=4, label=ALL)
    out = list(curve.excluded)
    axes.plot(x[out], terms[ALL][out], "x", color=EXCLUDED, markersize=5)
    axes.axhline(0, color=INK, linewidth=0.5)
    axes.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=5)


def _one_term(
    axes: Axes, found: Curves, terms: list[Array], across: Across, measured: bool
) -> None:
    """Draw one term of all curves, each in its own colour; what was measured as points."""
    for k, (curve, values) in enumerate(zip(found.curves, terms, strict=True)):
        mark = "-" if found.joined and not measured else "."
        colour = COLOURS[k % len(COLOURS)]
        axes.plot(across.place(curve.x), values, mark, color=colour, markersize=2.5)
    axes.axhline(0, color=INK, linewidth=0.5)


def _remainder(axes: Axes, found: Curves, across: Across) -> None:
    """Draw what all causes leave, in σ."""
    largest = 0.0
    for k, curve in enumerate(found.curves):
        colour = COLOURS[k % len(COLOURS)] if len(found.curves) > 1 else INK
        away = (curve.data - curve.predictions[0]) / curve.sd
        largest = max(largest, float(np.nanmax(np.abs(away))))
        x = across.place(curve.x)
        out = list(curve.excluded)
        axes.plot(x, away, ".", markersize=3, color=colour, label=as_written(curve.name))
        axes.plot(x[out], away[out], "x", color=EXCLUDED, markersize=5)
    residual_axis(axes, largest)
    axes.set_title(LEFT, fontsize=8)


def _images(found: Images) -> Figure:
    """One row a harmonic: its deviation and each term in the same colours, and the remainder."""
    names = found.models[2:]
    causes, together = contributed(found.predictions)
    columns = [found.data - found.predictions[1], *causes]
    titles = [ALL, *names]
    if _interacts(together, found.noise):
        columns.append(together)
        titles.append(TOGETHER)
    rest = found.data - found.predictions[0]
    panel = min(WIDE / (len(columns) + 1), 1.9)
    aspect = np.ptp(found.y) / max(np.ptp(found.x), 1e-300)
    height = len(found.harmonic) * panel * min(max(aspect, 0.4), 1.6) * 0.9 + 0.5
    figure = new_figure(max(panel * (len(columns) + 1), 4.6), height)
    panels = figure.subplots(len(found.harmonic), len(columns) + 1, squeeze=False)
    for axes, title in zip(panels[0], [*titles, LEFT], strict=True):
        axes.set_title(title, fontsize=7.5)
    for number, (row, n) in enumerate(zip(panels, found.harmonic, strict=True)):
        # The quadrature that holds most of what is changed
        turn = np.exp(-1j * signal_phase(columns[0][number]))
        values = [(column[number] * turn).real for column in columns]
        limit = symmetric_limit(np.concatenate([v.ravel() for v in values]))
        for axes, shown in zip(row, values, strict=False):
            paint(axes, found, shown, limit)
        left = (rest[number] * turn).real / found.noise
        widest = max(FAINTEST, symmetric_limit(left, 0.99))
        image = paint(row[-1], found, left, widest)
        ring_excluded(row[0], found, number)
        name_row(row[0], n, limit)
        bar_of_sigma(figure, row[-1], image, widest)
    scale_bar(panels[-1, 0], float(np.ptp(found.x)))
    return figure
