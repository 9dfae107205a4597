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
    axis_across,
    bare,
    image_bar,
    name_ticks,
    residual_axis,
    ring_excluded,
)
from femnl.plot.style import (
    COLOURS,
    INK,
    WIDTH,
    axis_label,
    new_figure,
    prefixed,
    scale_bar,
    style,
    symmetric_limit,
)

Array = NDArray[np.float64]
ALL = "measured − no cause"
TOGETHER = "interaction"


def contributions_figure(comparison: Comparison) -> Figure:
    """Draw what each cause changes of the data, their interaction, and what remains.

    Args: comparison: models with all causes, with none, and without each of the causes, which the
        names of the models from the third on say.
    Returns: the Figure. The interaction is drawn where it exceeds the noise anywhere.
    """
    with style():
        return _images(comparison) if isinstance(comparison, Images) else _curves(comparison)


def _terms(curve: Curve, names: tuple[str, ...]) -> dict[str, Array]:
    """Return the deviation from the idle model, each contribution, and the interaction."""
    causes, together = contributed(curve.predictions)
    deviation = curve.data - curve.predictions[1]
    return {ALL: deviation, **dict(zip(names, causes, strict=True)), TOGETHER: together}


def _interacts(together: Array, sd: Array | float) -> bool:
    """Whether causes interact by more than noise somewhere; less than that could not be seen."""
    return bool(np.nanmax(np.abs(together) / sd, initial=0.0) > 1)


def _curves(found: Curves) -> Figure:
    """Draw a single curve's terms in one panel, those of several curves in a panel each."""
    names = found.models[2:]
    terms = [_terms(curve, names) for curve in found.curves]
    shown = [ALL, *names]
    pairs = zip(found.curves, terms, strict=True)
    if any(_interacts(own[TOGETHER], curve.sd) for curve, own in pairs):
        shown.append(TOGETHER)
    single = len(found.curves) == 1
    heights = [2.2, 1.0] if single else [1.0] * (len(shown) + 1)
    figure = new_figure(height=1.35 * sum(heights) + 0.4)
    panels = figure.subplots(
        len(heights), 1, sharex=True, squeeze=False, gridspec_kw={"height_ratios": heights}
    )[:, 0]
    across = axis_across(found)
    scale, y_unit = prefixed(
        np.concatenate([own[name] for own in terms for name in shown]), found.y_unit
    )
    label = axis_label(f"change of {found.y}" if single else f"Δ {found.y}", y_unit)
    if single:
        _one_curve(panels[0], found, {n: terms[0][n] / scale for n in shown}, across.place)
        panels[0].set_ylabel(label)
        panels[0].legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=3)
    else:
        for axes, name in zip(panels, shown, strict=False):
            _one_term(axes, found, [own[name] / scale for own in terms], across.place)
            axes.set_title(name, fontsize=8)
            axes.set_ylabel(label, fontsize=7)
        _alike(panels[:-1])
    _remainder(panels[-1], found, across.place)
    panels[-1].set_xlabel(axis_label(across.name, across.unit))
    if found.ticks:
        name_ticks(panels[-1], found.ticks)
    if 1 < len(found.curves) <= len(COLOURS):
        figure.legend(
            *panels[-1].get_legend_handles_labels(), loc="outside lower center", ncols=4
        )
    return figure
