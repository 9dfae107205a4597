"""The film as VTK sees it.

Fields on curved triangles, drawn from above to scale, or raised into a relief.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pyvista as pv
from matplotlib.colors import Normalize, PowerNorm
from numpy.typing import NDArray

from femnl.core.choices import PICTURES
from femnl.core.errors import ParameterError
from femnl.core.modes import Modes
from femnl.core.outline import Outline
from femnl.core.surface import Surface
from femnl.device.geometry.curves import polyline
from femnl.plot.screen import need_offscreen
from femnl.plot.style import DIVERGING, INK, SEQUENTIAL

Image = NDArray[np.uint8]
TALLEST = 4000
"""Pixels of a picture; it is drawn twice as large, and graphics cards draw up to 16 384."""
Box = tuple[float, float, float, float]
"""Left, right, bottom and top, in m."""

METRE = 1e6  # VTK works in single precision, so lengths go to it in µm
FINE = 30_000  # triangles up to which each one is cut into 64 flat ones; beyond, into 4
# Power of the scale of stress, which peaks at the rims of holes and varies by percents elsewhere
RIMS = 0.35
RELIEF = 0.22  # height of a raised shape, in lengths of the film
PAPER = pv.Color("white")


@dataclass(frozen=True)
class Field:
    """What a picture shows: values at the surface's nodes, None for the bare mesh.

    The words at the colour bar; colours and their scale.
    """

    values: NDArray[np.float64] | None
    label: str
    colours: str
    scale: Normalize

    @property
    def shade(self) -> NDArray[np.float64]:
        """Place of each value on the colour scale, 0 to 1."""
        return (
            np.zeros(0)
            if self.values is None
            else np.asarray(self.scale(self.values), dtype=np.float64)
        )


def film_field(modes: Modes, surface: Surface, what: str, mode: int = 1) -> Field:
    """Return the field that a word asks for.

    `mesh`, `stress` (von Mises over film stress), `shape` (ξ of mode 1, 2, …), `thickness`.

    The relaxed stress counts as σ_vM = √(σ_xx² − σ_xx σ_yy + σ_yy² + 3σ_xy²), which equals the film
    stress where nothing has relaxed.
    Raises: ParameterError.
    """
    if what not in PICTURES:
        raise ParameterError(f"picture of {what!r}: femnl draws {', '.join(PICTURES)}")
    if what == "mesh":
        return Field(None, "", SEQUENTIAL, Normalize(0.0, 1.0))
    if what == "stress":
        xx, yy, xy = surface.stress.T
        values = np.sqrt(xx**2 - xx * yy + yy**2 + 3 * xy**2) / modes.domain.model.film.stress
        return Field(values, "von Mises stress / film stress", SEQUENTIAL, _scale(values, RIMS))
    if what == "thickness":
        return Field(
            surface.thickness * 1e9,
            "thickness (nm)",
            SEQUENTIAL,
            _scale(surface.thickness * 1e9, 1.0),
        )
    if not 1 <= mode <= len(modes.frequency):
        raise ParameterError(
            f"mode {mode}: {len(modes.frequency)} modes were solved; choose 1 to "
            f"{len(modes.frequency)} or solve more"
        )
    return Field(surface.shapes[mode - 1], "shape ξ", DIVERGING, Normalize(-1.0, 1.0))


def _scale(values: NDArray[np.float64], power: float) -> Normalize:
    low = float(values.min())
    high = float(values.max())
    if high - low < 1e-3 * abs(high):  # an even film would otherwise show its rounding
        return Normalize(low - 0.05 * abs(high), high + 0.05 * abs(high))
    return PowerNorm(power, low, high)


def film_box(outline: Outline, margin: float = 0.02) -> Box:
    """Return the box of an outline with a margin in parts of its longer side."""
    line = polyline(outline)
    (left, bottom) = line.min(0)
    (right, top) = line.max(0)
    room = margin * max(right - left, top - bottom)
    return float(left - room), float(right + room), float(bottom - room), float(top + room)


def draw_flat(modes: Modes, surface: Surface, field: Field, box: Box, width: int = 1000) -> Image:
    """Draw the part of the film in a box from above, to scale. Returns: (height, width, 3) pixels.

    A slender film that stands is drawn narrower, up to `TALLEST` pixels.
    Raises: MissingLibraryError.
    """
    tall = (box[3] - box[2]) / (box[1] - box[0])
    width = max(1, min(width, round(TALLEST / tall)))
    plotter = _offscreen(width, round(width * tall))
    add_film(plotter, surface, field, box)
    add_outline(plotter, modes.domain.model.outline)
    for lamina in modes.domain.model.layers:
        for rim in lamina.rims:
            add_outline(plotter, rim)
    look_down(plotter, box)
    return _photograph(plotter)


def draw_raised(modes: Modes, surface: Surface, field: Field, width: int = 1400) -> Image:
    """Draw a mode shape as a relief seen from the front and above, cut to its content.

    Raises: MissingLibraryError.
    """
    plotter = _offscreen(width, round(0.72 * width))
    raise_film(plotter, modes, surface, field)
    image = _photograph(plotter)
    rows, columns = (np.flatnonzero((image < 250).any(axis=(2, other))) for other in (1, 0))
    return image[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]


def raise_film(
    plotter: pv.Plotter, modes: Modes, surface: Surface, field: Field, bar: bool = False
) -> None:
    """Put the relief of a shape and the outline at rest into a scene, seen from above."""
    height = RELIEF * METRE * modes.domain.model.outline.length
    solid = _triangles(surface, field, None)
    # The shade of a shape runs from 0 to 1 where ξ runs from −1 to 1.
    relief = solid.warp_by_scalar("shade", factor=2 * height).translate((0, 0, -height))
    plotter.add_mesh(
        relief, smooth_shading=True, ambient=0.4, diffuse=0.65, specular=0.0, **_colours(field, bar)
    )
    add_outline(plotter, modes.domain.model.outline)
    plotter.camera.parallel_projection = True
    plotter.camera.focal_point = (0.0, 0.0, 0.0)
    plotter.camera.position = (-0.45 * METRE, -1.0 * METRE, 0.75 * METRE)
    plotter.camera.up = (0.0, 0.0, 1.0)
    plotter.renderer.reset_camera()
    plotter.camera.zoom(1.25)


def look_down(plotter: pv.Plotter, box: Box) -> None:
    """Look at a box of the film from above, so that the box fills the height of the window."""
    left, right, bottom, top = (METRE * edge for edge in box)
    plotter.camera.parallel_projection = True
    plotter.camera.focal_point = ((left + right) / 2, (bottom + top) / 2, 0.0)
    plotter.camera.position = ((left + right) / 2, (bottom + top) / 2, right - left)
    plotter.camera.up = (0.0, 1.0, 0.0)
    plotter.camera.parallel_scale = (top - bottom) / 2


def add_film(
    plotter: pv.Plotter, surface: Surface, field: Field, box: Box | None = None, bar: bool = False
) -> None:
    """Put the film, or its part in a box, into a scene.

    Coloured by the field, or the bare mesh with its edges.
    """
    if field.values is None:
        plotter.add_mesh(_triangles(surface, field, box), color="#dbe9f6", lighting=False)
        plotter.add_mesh(
            _grid(surface, field, box).extract_all_edges(),
            color="#1f4e79",
            line_width=1,
            lighting=False,
        )
        return
    plotter.add_mesh(_triangles(surface, field, box), lighting=False, **_colours(field, bar))


def _colours(field: Field, bar: bool) -> dict[str, Any]:
    """Options of add_mesh; annotations are labels of a window's scalar bar at quarters."""
    quarters = np.linspace(0.0, 1.0, 5)
    marks = {
        float(shade): f"{value:.3g}"
        for shade, value in zip(quarters, field.scale.inverse(quarters), strict=True)
    }
    words = {
        "title": field.label.replace(" / ", "\n/ "),
        "n_labels": 0,
        "color": INK,
        "vertical": True,
        "position_x": 0.88,
        "position_y": 0.2,
        "height": 0.6,
    }
    shades = {"scalars": "shade", "cmap": field.colours, "clim": (0.0, 1.0), "annotations": marks}
    return shades | {"show_scalar_bar": bar, "scalar_bar_args": words}


def add_outline(plotter: pv.Plotter, outline: Outline) -> None:
    """Put the outline at rest into a scene."""
    line = np.vstack([polyline(outline), polyline(outline)[:1]]) * METRE
    plotter.add_mesh(
        pv.lines_from_points(np.column_stack([line, np.zeros(len(line))])),
        color=INK,
        line_width=2,
        lighting=False,
    )


def _grid(surface: Surface, field: Field, box: Box | None) -> pv.UnstructuredGrid:
    """The quadratic triangles, with the field's `shade` at their nodes.

    Those alone that reach into the box, where one is given.
    """
    triangles = surface.triangles
    if box is not None:
        corners = surface.points[triangles]
        (x0, y0) = np.moveaxis(corners.min(1), -1, 0)
        (x1, y1) = np.moveaxis(corners.max(1), -1, 0)
        triangles = triangles[(x1 > box[0]) & (x0 < box[1]) & (y1 > box[2]) & (y0 < box[3])]
    points = np.column_stack([surface.points * METRE, np.zeros(len(surface.points))])
    grid = pv.UnstructuredGrid({pv.CellType.QUADRATIC_TRIANGLE: triangles}, points)
    if field.values is not None:
        grid["shade"] = field.shade
    return grid


def _triangles(surface: Surface, field: Field, box: Box | None) -> pv.PolyData:
    grid = _grid(surface, field, box)
    level = 3 if grid.n_cells <= FINE else 1
    return grid.extract_surface(
        algorithm="dataset_surface",
        nonlinear_subdivision=level,
        pass_pointid=False,
        pass_cellid=False,
    )


def _offscreen(width: int, height: int) -> pv.Plotter:
    need_offscreen()
    plotter = pv.Plotter(off_screen=True, window_size=[width, height])
    plotter.background_color = PAPER
    plotter.enable_anti_aliasing("ssaa")
    return plotter


def _photograph(plotter: pv.Plotter) -> Image:
    image = plotter.screenshot(None, return_img=True)
    plotter.close()
    return np.asarray(image, dtype=np.uint8)
