"""The mechanical part of the page: modes, their nonlinearity, and the pictures of each device."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import get_args

from femnl.core.device import Edge, Model
from femnl.core.modes import Modes
from femnl.core.nonlinearity import Nonlinearity
from femnl.core.numbers import plain, ppm, with_error
from femnl.device.geometry.reader import describe, load
from femnl.pipeline import solve_modes, solve_nonlinearity
from femnl.plot.mechanics import film_figure, mode_gallery
from femnl.report.picture import Picture, embed
from femnl.report.published import Device, Published

COUNT = 10
EDGES: tuple[Edge, ...] = get_args(Edge)

Say = Callable[[str], None]
Row = tuple[str, ...]


@dataclass(frozen=True)
class Geometry:
    """One geometry of a device, solved."""

    model: Model
    modes: Modes
    nonlinearity: dict[Edge, Nonlinearity]

    @property
    def keys(self) -> list[str]:
        """What published numbers call each mode: its label, or else its number."""
        return [label or str(k) for k, label in enumerate(self.modes.label, start=1)]


@dataclass(frozen=True)
class Part:
    """A geometry on the page: words, table of modes, table of α, pictures."""

    name: str
    description: str
    source: str
    assumed: tuple[str, ...]
    modes: list[Row]
    edge: str
    pictures: list[Picture]


def solve(device: Device, say: Say, cache: bool) -> list[Geometry]:
    """Solve every geometry of a device."""
    solved = []
    for name in device.geometries:
        model = load(name)
        say(f"{model.name}: modes")
        modes = solve_modes(model, COUNT, cache=cache)
        nonlinearity = {}
        for edge in EDGES:
            say(f"{model.name}: α with {edge} edges")
            nonlinearity[edge] = solve_nonlinearity(modes, edge, cache=cache)
        solved.append(Geometry(model, modes, nonlinearity))
    return solved


def summary_of(geometry: Geometry) -> list[tuple[str, str]]:
    """Name the numbers of the fundamental mode that everyone asks for first."""
    modes = geometry.modes
    duffing = geometry.nonlinearity[geometry.model.edge]
    alpha = with_error(duffing.alpha[0] / 1e9, duffing.alpha_error[0] / 1e9)
    frequency = with_error(modes.frequency[0] / 1e6, modes.frequency_error[0] / 1e6)
    return [
        ("f₁ (MHz)", frequency),
        ("effective mass (ng)", plain(modes.effective_mass[0] * 1e12, 5)),
        (f"α (10⁻³ µm⁻²), {geometry.model.edge} edge", alpha),
    ]


def describe_geometry(geometry: Geometry, say: Say) -> Part:
    """Write up one geometry: its table of modes and its pictures."""
    model = geometry.model
    modes = geometry.modes
    say(f"{model.name}: pictures")
    pictures = [
        embed(
            mode_gallery(modes, COUNT),
            f"First {COUNT} mode shapes of {model.name}",
            "Mode shapes ξ, largest value 1.",
        ),
        embed(
            film_figure(modes, "shape", 1),
            f"Fundamental mode of {model.name}",
            "The fundamental mode, from above and as a relief.",
        ),
        embed(
            film_figure(modes, "mesh"),
            f"Mesh of {model.name}",
            "The mesh, unfolded from the part that symmetry leaves to solve.",
        ),
    ]
    if model.pierced:
        caption = (
            "Stress after release: holes are free, so that the tension flows around them. The "
            "scale is stretched at its lower end."
        )
        pictures.append(
            embed(film_figure(modes, "stress"), f"Relaxed stress of {model.name}", caption)
        )
    return Part(
        model.name,
        describe(model),
        model.source,
        model.assumed,
        _mode_rows(geometry),
        model.edge,
        pictures,
    )


def _mode_rows(geometry: Geometry) -> list[Row]:
    modes = geometry.modes
    duffing = geometry.nonlinearity[geometry.model.edge]
    return [
        (
            str(k + 1),
            modes.label[k] or "",
            with_error(modes.frequency[k] / 1e6, modes.frequency_error[k] / 1e6),
            with_error(modes.ratio[k], modes.ratio_error[k]),
            plain(modes.effective_mass[k] * 1e12, 5),
            plain(duffing.k3[k] / 1e12, 5),
            with_error(duffing.alpha[k] / 1e9, duffing.alpha_error[k] / 1e9),
        )
        for k in range(len(modes.frequency))
    ]


def ratio_table(geometries: list[Geometry], published: Published) -> tuple[Row, list[Row]]:
    """Return head and rows of ratios f/f₁ beside those of an ideal membrane and published ones."""
    head = ("mode", "ideal", f"published, {published.ratio_kind}")
    rows = []
    for key in _keys(geometries):
        cells = [key, _known(published.ideal, key), _known(published.ratio, key)]
        for geometry in geometries:
            cells += _beside(geometry, key, published)
        rows.append(tuple(cells))
    return (*head, *(word for g in geometries for word in (g.model.name, "− published"))), rows


def _keys(geometries: list[Geometry]) -> list[str]:
    """Return the keys of the modes of all geometries, by ratio in the first that has them."""
    found: dict[str, float] = {}
    for geometry in geometries:
        found = dict(zip(geometry.keys, geometry.modes.ratio.tolist(), strict=True)) | found
    return sorted(found, key=lambda key: found[key])


def _known(table: dict[str, float], key: str) -> str:
    return plain(table[key]) if key in table else ""


def _beside(geometry: Geometry, key: str, published: Published) -> list[str]:
    """Return the ratio of one mode and its difference to the published one.

    Empty where this geometry has no such mode.
    """
    if key not in geometry.keys:
        return ["", ""]
    k = geometry.keys.index(key)
    modes = geometry.modes
    known = published.ratio.get(key)
    return [
        with_error(modes.ratio[k], modes.ratio_error[k]),
        "" if known is None else ppm(modes.ratio[k], known),
    ]


def frequency_table(geometries: list[Geometry], published: Published) -> list[Row]:
    """Measured frequencies, and 2:1 detuning where it was measured, beside the computed ones."""
    rows = []
    for key, value in published.frequency.items():
        cells = [
            f"f{key if key.startswith('(') else ''} (MHz)"
            if len(published.frequency) > 1
            else "f₁ (MHz)",
            f"{value / 1e6:.10g}",
        ]
        for geometry in geometries:
            k = geometry.keys.index(key)
            cells.append(
                with_error(
                    geometry.modes.frequency[k] / 1e6, geometry.modes.frequency_error[k] / 1e6
                )
            )
            cells.append(ppm(geometry.modes.frequency[k], value))
        rows.append(tuple(cells))
    if {"(1,1)", "(2,2)"} <= set(published.frequency):
        gap = published.frequency["(2,2)"] - 2 * published.frequency["(1,1)"]
        cells = ["f(2,2) − 2 f(1,1) (Hz)", f"{gap:.0f}"]
        for geometry in geometries:
            value, error = _gap(geometry)
            cells += [with_error(value, error), f"{value - gap:+.0f} Hz".replace("-", "−")]
        rows.append(tuple(cells))
    return rows


def _gap(geometry: Geometry) -> tuple[float, float]:
    """Return f(2,2) − 2 f(1,1) and its discretisation error [Hz]."""
    first, second = (geometry.keys.index(key) for key in ("(1,1)", "(2,2)"))
    modes = geometry.modes
    f = modes.frequency[first]
    ratio = modes.ratio[second] / modes.ratio[first]
    error = modes.ratio_error
    unlike = error[second] + ratio * error[first]
    return float(f * (ratio - 2)), float(f * unlike + abs(ratio - 2) * modes.frequency_error[first])


def alpha_table(geometries: list[Geometry], published: Published | None) -> tuple[Row, list[Row]]:
    """Return head and rows of α under each in-plane edge, beside the published formula.

    The unit is 10⁻³ µm⁻².
    """
    known = published.alpha if published is not None else {}
    head = ["mode", *(["published formula"] if known else [])]
    head += [f"{geometry.model.name}, {edge}" for geometry in geometries for edge in EDGES]
    rows = []
    for key in _keys(geometries):
        cells = [key]
        if known:
            cells.append(plain(known[key] / 1e9, 4) if key in known else "")
        for geometry in geometries:
            k = geometry.keys.index(key) if key in geometry.keys else None
            for edge in EDGES:
                duffing = geometry.nonlinearity[edge]
                cells.append(
                    ""
                    if k is None
                    else with_error(duffing.alpha[k] / 1e9, duffing.alpha_error[k] / 1e9)
                )
        rows.append(tuple(cells))
    return tuple(head), rows
