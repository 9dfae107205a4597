"""What a notebook shows of a device, its modes and its harmonic maps: a picture."""

from functools import singledispatch
from io import BytesIO

from matplotlib.collections import EllipseCollection
from matplotlib.figure import Figure

from femnl.core.device import Model
from femnl.core.mechanics import Modes
from femnl.core.readout import HarmonicMap
from femnl.device.geometry.curves import polyline
from femnl.io.measurement import harmonic_map
from femnl.plot.maps import harmonic_map_figure
from femnl.plot.mechanics import mode_gallery
from femnl.plot.style import INK, new_figure, style

MOST = 10  # modes shown


def picture(value: Model | Modes | HarmonicMap) -> bytes:
    """Draw a device, modes or maps as PNG."""
    stream = BytesIO()
    draw(value).savefig(stream, format="png", dpi=110)
    return stream.getvalue()


@singledispatch
def draw(value: object) -> Figure:
    """Draw a value; one function a type."""
    raise TypeError(f"no picture of a {type(value).__name__}")


@draw.register
def _(model: Model) -> Figure:
    x, y = polyline(model.outline).T * 1e6
    with style():
        figure = new_figure(3.2, 3.2)
        axes = figure.subplots()
        axes.fill(x, y, facecolor="0.92", edgecolor=INK, linewidth=1.0)
        size = 2e6 * model.holes.radius
        centres = model.holes.centres * 1e6
        holes = EllipseCollection(
            size,
            size,
            0,
            units="xy",
            offsets=centres,
            offset_transform=axes.transData,
            facecolor="white",
        )
        holes.set(edgecolor=INK, linewidth=0.3)
        axes.add_collection(holes)
        axes.set(aspect="equal", xlabel="x (µm)", ylabel="y (µm)", title=model.name)
    return figure


@draw.register
def _(modes: Modes) -> Figure:
    return mode_gallery(modes, min(MOST, len(modes.frequency)))


@draw.register
def _(maps: HarmonicMap) -> Figure:
    return harmonic_map_figure(
        harmonic_map(maps.x, maps.y, maps.harmonic, maps.values, wavelength=maps.wavelength)
    )
