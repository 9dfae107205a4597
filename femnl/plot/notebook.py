"""What a notebook shows of a device, its modes and its harmonic maps: pictures and tables."""

from base64 import b64encode
from functools import singledispatch
from io import BytesIO

from matplotlib.collections import EllipseCollection
from matplotlib.figure import Figure

from femnl.core.device import Model
from femnl.core.modes import Modes
from femnl.core.readout import HarmonicMap
from femnl.core.tables import Tabulated
from femnl.device.geometry.curves import polyline
from femnl.plot.style import INK, new_figure, style


def bundle(value: Model | Modes | HarmonicMap) -> dict[str, bytes | str]:
    """Return what a notebook shows, by MIME type: PNG, and HTML with table and picture.

    Where there is HTML a notebook shows nothing else, so that the picture is in it too.
    """
    content = picture(value)
    if not isinstance(value, Tabulated):
        return {"image/png": content}
    source = f"data:image/png;base64,{b64encode(content).decode()}"
    image = f'<img src="{source}" alt="{type(value).__name__}" style="max-width: 100%">'
    return {"image/png": content, "text/html": f"{value._repr_html_()}\n{image}"}


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
        for opening in model.openings:
            axes.fill(*polyline(opening).T * 1e6, facecolor="white", edgecolor=INK, linewidth=0.5)
        axes.set(aspect="equal", xlabel="x (µm)", ylabel="y (µm)", title=model.name)
    return figure


@draw.register
def _(value: Modes | HarmonicMap) -> Figure:
    return value.plot()
