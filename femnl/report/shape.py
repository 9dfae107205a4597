"""Mode shapes that a reader can turn: data for plotly.js, which stands in the page."""

from base64 import b64encode
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.colors import to_hex
from numpy.typing import NDArray

from femnl.core.modes import Modes
from femnl.device.geometry.curves import polyline
from femnl.io.results.surface import unfold
from femnl.plot.mechanics import film_figure
from femnl.plot.style import DIVERGING
from femnl.report.picture import Picture, embed

LIBRARY = Path(__file__).parent / "vendor" / "plotly-gl3d.min.js"
"""The part of plotly.js that draws in three dimensions, as its makers publish it."""
RELIEF = 0.22
"""Height of ξ = 1, in lengths of the film's longer side."""
SAME = 1e-6
"""Distance, in lengths of the film, below which two nodes are one."""
FLAT = np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]])
"""A triangle of six nodes (corners, then middles of edges 01, 12, 20) as four flat ones."""


@dataclass(frozen=True)
class Shape:
    """Shapes to turn.

    The device's name, words for each mode, plotly.js, what it draws, and a picture to replace
    it.
    """

    name: str
    modes: list[str]
    library: str
    data: dict[str, Any]
    still: Picture


def turning(modes: Modes) -> Shape:
    """Put all mode shapes of a film into a scene that plotly.js draws.

    Flat triangles, raised and coloured by ξ.
    """
    name = modes.domain.model.name
    points, triangles, shapes = _surface(modes)
    size = np.ptp(points, axis=0)
    shades = mpl.colormaps[DIVERGING](np.linspace(0, 1, 11))
    index = "u2" if len(points) < 2**16 else "u4"
    film = {
        "type": "mesh3d",
        **{axis: _packed(points[:, k] * 1e6, "f4") for k, axis in enumerate("xy")},
        **{corner: _packed(triangles[:, k], index) for k, corner in enumerate("ijk")},
        "colorscale": [[k / 10, to_hex(shade)] for k, shade in enumerate(shades)],
        "cmin": -1,
        "cmax": 1,
        "colorbar": {
            "orientation": "h",
            "thickness": 12,
            "len": 0.6,
            "y": 0.0,
            "yanchor": "bottom",
        },
        "hovertemplate": "x = %{x:.1f} µm<br>y = %{y:.1f} µm<br>ξ = %{z:.3f}<extra></extra>",
        "lighting": {"ambient": 0.55, "diffuse": 0.6, "specular": 0.05},
    }
    line = polyline(modes.domain.model.outline)
    line = np.vstack([line, line[:1]]) * 1e6
    edge = {
        "type": "scatter3d",
        "mode": "lines",
        "hoverinfo": "skip",
        **{axis: _packed(line[:, k], "f4") for k, axis in enumerate("xy")},
        "z": _packed(np.zeros(len(line)), "f4"),
    }
    view = {
        "xaxis": {"title": {"text": "x (µm)"}},
        "yaxis": {"title": {"text": "y (µm)"}},
        "zaxis": {"title": {"text": "ξ"}, "range": [-1, 1], "nticks": 5},
        "aspectmode": "manual",
        "aspectratio": {"x": size[0] / size.max(), "y": size[1] / size.max(), "z": 2 * RELIEF},
        "camera": {
            "eye": {"x": -0.85, "y": -1.5, "z": 0.95},
            "center": {"x": 0, "y": 0, "z": -0.1},
        },
    }
    data = {
        "film": film,
        "edge": edge,
        "scene": view,
        "shapes": [_packed(shape, "f4") for shape in shapes],
    }
    still = embed(
        film_figure(modes, "shape", 1),
        f"Fundamental mode of {name}",
        "The fundamental mode, from above and as a relief.",
    )
    words = [_words(modes, k) for k in range(len(shapes))]
    return Shape(name, words, LIBRARY.read_text("utf-8"), data, still)


def _surface(modes: Modes) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.float64]]:
    """Return nodes of the whole film [m], each once, flat triangles between them, and shapes."""
    surface = unfold(modes)
    places = np.round(surface.points / (SAME * modes.domain.model.outline.length)).astype(np.int64)
    _, first, index = np.unique(places, axis=0, return_index=True, return_inverse=True)
    return (
        surface.points[first],
        index[surface.triangles[:, FLAT].reshape(-1, 3)],
        surface.shapes[:, first],
    )


def _packed(values: NDArray[Any], kind: str) -> dict[str, str]:
    """Return numbers as plotly.js unpacks them: the bytes of a typed array."""
    return {
        "dtype": kind,
        "bdata": b64encode(np.asarray(values, dtype=f"<{kind}").tobytes()).decode(),
    }


def _words(modes: Modes, index: int) -> str:
    label = f" {modes.label[index]}" if modes.label[index] else ""
    return f"{index + 1}{label}, {modes.frequency[index] / 1e6:.4f} MHz"
