"""Pictures of the film: mesh, relaxed stress, mode shapes, thickness."""

from pathlib import Path

import numpy as np
import pyvista as pv
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from scipy.spatial import cKDTree

from femnl.core.choices import PICTURE_FORMATS
from femnl.core.device import Model
from femnl.core.errors import ParameterError
from femnl.core.modes import Modes
from femnl.core.outline import Holes
from femnl.io.results.atomic import write_whole
from femnl.io.results.surface import unfold
from femnl.plot.film import (
    PAPER,
    Box,
    Field,
    Image,
    add_film,
    add_outline,
    draw_flat,
    draw_raised,
    film_box,
    film_field,
    look_down,
    raise_film,
)
from femnl.plot.screen import need_window
from femnl.plot.style import COLOURS, INK, WIDTH, new_figure, prefixed, scale_bar, style

COLUMNS = 5
DPI = 200


def view(modes: Modes, what: str, mode: int = 1, out: Path | None = None) -> None:
    """Show the film in a window, or draw it into a file.

    Args: what: `mesh`, `stress`, `shape` or `thickness`. mode: which shape, from 1. out: PNG, PDF
    or SVG; None opens a window.
    Raises: ParameterError; MissingLibraryError where OpenGL or, for a window, a display is missing.
    """
    if out is not None:
        if out.suffix not in PICTURE_FORMATS:
            raise ParameterError(
                f"{out}: pictures are written as {', '.join(PICTURE_FORMATS)}; choose one of these "
                "endings"
            )
        figure = film_figure(modes, what, mode)
        write_whole(out, lambda file: figure.savefig(file, dpi=DPI))
        return
    surface = unfold(modes)
    field = film_field(modes, surface, what, mode)
    need_window()
    plotter = pv.Plotter(title=f"femnl: {_heading(modes, what, mode)}")
    plotter.background_color = PAPER
    if what == "shape":
        raise_film(plotter, modes, surface, field, bar=True)
    else:
        add_film(plotter, surface, field, bar=True)
        add_outline(plotter, modes.domain.model.outline)
        look_down(plotter, film_box(modes.domain.model.edge_outline, 0.2))
        # The font of VTK has no µ.
        plotter.renderer.show_bounds(
            xtitle="x (um)", ytitle="y (um)", location="outer", show_zaxis=False, color=INK
        )
    plotter.show()


def film_figure(modes: Modes, what: str, mode: int = 1) -> Figure:
    """Draw the whole film and beside it a closer look: at holes or a corner, or at a mode's relief.

    Args, Raises: see `view`.
    """
    surface = unfold(modes)
    field = film_field(modes, surface, what, mode)
    model = modes.domain.model
    whole = film_box(model.edge_outline)
    near = (
        None
        if what == "shape" or (what != "mesh" and not len(model.holes.centres))
        else close_up(model)
    )
    aspect = min(max((whole[3] - whole[2]) / (whole[1] - whole[0]), 0.5), 1.6)
    single = near is None and what != "shape"
    with style():
        figure = new_figure(
            WIDTH * (0.58 if single else 1),
            WIDTH * aspect * (0.48 if field.values is None or single else 0.43) + 0.3,
        )
        figure.suptitle(_heading(modes, what, mode), fontsize=10)
        panels = figure.subplots(1, 1 if single else 2, squeeze=False).ravel()
        place_image(panels[0], draw_flat(modes, surface, field, whole), whole)
        if near is not None:
            place_image(panels[1], draw_flat(modes, surface, field, near), near)
            frame = Rectangle(
                (1e6 * near[0], 1e6 * near[2]), 1e6 * (near[1] - near[0]), 1e6 * (near[3] - near[2])
            )
            frame.set(facecolor="none", edgecolor=COLOURS[1], linewidth=1.0)
            panels[0].add_patch(frame)
            panels[1].spines[:].set_color(COLOURS[1])
        elif what == "shape":
            panels[1].imshow(draw_raised(modes, surface, field))
            panels[1].set_axis_off()
        if field.values is not None:
            _colour_bar(figure, list(panels), field)
    return figure


def mode_gallery(modes: Modes, count: int = 10) -> Figure:
    """Draw the first mode shapes from above, with labels and frequencies."""
    surface = unfold(modes)
    box = film_box(modes.domain.model.edge_outline)
    count = min(count, len(modes.frequency))
    rows = -(-count // COLUMNS)
    aspect = (box[3] - box[2]) / (box[1] - box[0])
    with style():
        figure = new_figure(
            WIDTH, rows * (0.92 * WIDTH / COLUMNS * min(max(aspect, 0.3), 2.0) + 0.45) + 0.1
        )
        panels = figure.subplots(rows, COLUMNS, squeeze=False).ravel()
        for index, axes in enumerate(panels):
            axes.set_axis_off()
            if index >= count:
                continue
            field = film_field(modes, surface, "shape", index + 1)
            axes.imshow(
                draw_flat(modes, surface, field, box, 420),
                extent=tuple(box),
                interpolation="lanczos",
            )
            axes.set_title(
                f"{index + 1}  {modes.label[index] or ''}\n{_frequency(modes, index)}", fontsize=8
            )
        scale_bar(panels[(rows - 1) * COLUMNS], box[1] - box[0])
        _colour_bar(figure, list(panels), film_field(modes, surface, "shape"))
    return figure


def close_up(model: Model) -> Box:
    """Return a box within the film's for a closer look.

    At the outermost hole and its neighbours, or at the farthest corner.
    """
    holes = model.holes
    marks = (
        holes.centres
        if len(holes.centres)
        else np.array([segment.start for segment in model.outline.segments])
    )
    half = 1.5 * _spacing(holes) if len(holes.centres) else model.outline.length / 14
    distance = np.hypot(*marks.T)
    farthest = marks[distance >= 0.999 * distance.max()]
    x, y = farthest[np.argmax(farthest @ [1.0, 1.001])]  # of several the one to the upper right
    left, right, bottom, top = film_box(model.edge_outline, 0.01)
    half = min(half, (right - left) / 2, (top - bottom) / 2)
    x = float(np.clip(x, left + half, right - half))
    y = float(np.clip(y, bottom + half, top - half))
    return x - half, x + half, y - half, y + half


def _spacing(holes: Holes) -> float:
    """Distance between neighbouring holes, or four radii where there is one hole only."""
    if len(holes.centres) < 2:
        return 4 * holes.radius
    nearest = np.asarray(cKDTree(holes.centres).query(holes.centres, k=2)[0])
    return float(np.median(nearest[:, 1]))


def place_image(axes: Axes, image: Image, box: Box) -> None:
    """Show a picture that was drawn to scale, with axes in µm."""
    axes.imshow(
        image,
        extent=(1e6 * box[0], 1e6 * box[1], 1e6 * box[2], 1e6 * box[3]),
        interpolation="lanczos",
    )
    axes.set_xlabel("x (µm)")
    axes.set_ylabel("y (µm)")
    axes.spines[:].set_visible(True)


def _colour_bar(figure: Figure, panels: list[Axes], field: Field) -> None:
    bar = figure.colorbar(
        ScalarMappable(field.scale, field.colours), ax=panels, shrink=0.85, aspect=26, pad=0.02
    )
    bar.set_label(field.label)
    values = [float(field.scale.inverse(shade)) for shade in np.linspace(0, 1, 5)]
    bar.set_ticks(values, labels=[f"{value:.3g}".replace("-", "−") for value in values])


def _heading(modes: Modes, what: str, mode: int) -> str:
    name = modes.domain.model.name
    if what != "shape":
        return f"{name}: {'relaxed stress' if what == 'stress' else what}"
    label = modes.label[mode - 1] or ""
    return f"{name}: mode {mode} {label} at {_frequency(modes, mode - 1)}".replace("  ", " ")


def _frequency(modes: Modes, index: int) -> str:
    divisor, unit = prefixed(modes.frequency[index], "Hz")
    return f"{modes.frequency[index] / divisor:.4f} {unit}"
