"""The measurement file, version 1.0, as data.

Which kinds there are and which datasets each has, with dimensions and units.
"""

from dataclasses import dataclass, field

VERSION = "1.0"


@dataclass(frozen=True)
class Item:
    """One dataset or scalar attribute.

    Its dimensions, its SI unit ("" has none, None is text) and its place in the Dataset.

    axis: values must rise strictly along the single dimension. A coordinate labels the data, the
    rest are the data.
    """

    dims: tuple[str, ...] = ()
    unit: str | None = ""
    required: bool = False
    coordinate: bool = False
    axis: bool = False
    positive: bool = False


@dataclass(frozen=True)
class Kind:
    """One kind of measurement: its datasets and attributes, and `needs`.

    Groups of datasets of which at least one must be there.
    """

    dims: tuple[str, ...]
    datasets: dict[str, Item]
    attributes: dict[str, Item] = field(default_factory=dict)
    needs: tuple[tuple[str, ...], ...] = ()


CONTROLS = {"pressure": "Pa", "temperature": "K", "laser_power": "W", "drive": "V", "time": "s"}

_NOISE = Item(unit="V", positive=True)
_WAVELENGTH = Item(unit="m", positive=True)
_AMPLITUDE = {"real": "V", "imag": "V"}


def _label(dim: str, unit: str | None) -> Item:
    return Item((dim,), unit, coordinate=True)


KINDS = {
    "spectrum": Kind(
        dims=("mode",),
        datasets={
            "frequency": Item(("mode",), "Hz", required=True, positive=True),
            "frequency_sd": Item(("mode",), "Hz", required=True, positive=True),
            "label": _label("mode", None),
            "time": _label("mode", "s"),
            "quality_factor": Item(("mode",), "", positive=True),
            "quality_factor_sd": Item(("mode",), "", positive=True),
        },
    ),
    "response": Kind(
        dims=("sweep", "point"),
        datasets={
            "frequency": Item(
                ("sweep", "point"), "Hz", required=True, coordinate=True, positive=True
            ),
            **{
                part: Item(("sweep", "point"), unit, required=True)
                for part, unit in _AMPLITUDE.items()
            },
            "drive": _label("sweep", "V"),
            "direction": _label("sweep", ""),
            "x": _label("sweep", "m"),
            "y": _label("sweep", "m"),
            "harmonic": _label("sweep", ""),
            "time": _label("sweep", "s"),
        },
        attributes={"noise_sd": _NOISE, "wavelength": _WAVELENGTH, "mode": Item(unit=None)},
    ),
    "map": Kind(
        dims=("harmonic", "y", "x"),
        datasets={
            **{
                part: Item(("harmonic", "y", "x"), unit, required=True)
                for part, unit in _AMPLITUDE.items()
            },
            "x": Item(("x",), "m", required=True, coordinate=True, axis=True),
            "y": Item(("y",), "m", required=True, coordinate=True, axis=True),
            "harmonic": Item(("harmonic",), "", required=True, coordinate=True, axis=True),
        },
        attributes={
            "noise_sd": _NOISE,
            "wavelength": _WAVELENGTH,
            "drive": Item(unit="V"),
            "drive_frequency": Item(unit="Hz", positive=True),
        },
    ),
    "trace": Kind(
        dims=("step", "time"),
        datasets={
            "voltage": Item(("step", "time"), "V", required=True),
            "drive_voltage": Item(("step", "time"), "V"),
            "time": Item(("time",), "s", required=True, coordinate=True, axis=True),
            "drive_frequency": _label("step", "Hz"),
        },
        attributes={
            "noise_sd": _NOISE,
            "wavelength": _WAVELENGTH,
            "x": Item(unit="m"),
            "y": Item(unit="m"),
        },
        needs=(("drive_frequency", "drive_voltage"),),
    ),
    "series": Kind(
        dims=("point",),
        datasets={
            **{name: _label("point", unit) for name, unit in CONTROLS.items()},
            "frequency": Item(("point",), "Hz", positive=True),
            "frequency_sd": Item(("point",), "Hz", positive=True),
            "quality_factor": Item(("point",), "", positive=True),
            "quality_factor_sd": Item(("point",), "", positive=True),
        },
        needs=(tuple(CONTROLS), ("frequency", "quality_factor")),
    ),
}
