"""Spectra: frequencies of modes, with quality factors and the pressure of gas where known."""

from typing import Any

from femnl.core.kinds import Contract, Cost, Item, KindSpec, Size, label


def modes_needed(dataset: Any) -> int:
    """Return how many simulated modes the measured ones are assigned among."""
    return max(48, 4 * int(dataset.sizes["mode"]))


KIND = KindSpec(
    name="spectrum",
    stages=("operators", "frequencies"),
    scales=frozenset(
        (
            "frequency",
            "crossing_time",
            "gap",
            "gas_loss",
            "highest_pressure",
            "layer_square",
            "layer_thickness",
            "mass",
            "pitch_square",
            "pressure",
            "quality_factor",
            "reach",
            "time",
        )
    ),
    pose="femnl.fits.spectrum.pose:pose",
    figure="femnl.plot.measurement:spectrum_figure",
    takes_layers=True,
    contract=Contract(
        dims=("mode",),
        datasets={
            "frequency": Item(("mode",), "Hz", required=True, positive=True),
            "frequency_sd": Item(("mode",), "Hz", required=True, positive=True),
            "label": label("mode", None),
            "time": label("mode", "s"),
            "quality_factor": Item(("mode",), "", positive=True),
            "quality_factor_sd": Item(("mode",), "", positive=True),
        },
        attributes={
            "pressure": Item(unit="Pa", positive=True),
            "wave_speed": Item(unit="m/s", positive=True),
            "wave_speed_sd": Item(unit="m/s", positive=True),
        },
    ),
    modes=modes_needed,
    size=Size(
        data="lines",
        remedy="leave out the highest lines",
        show=Cost(50.0),
        fit=Cost(50.0),
        diagnose=Cost(200.0, 160),
    ),
)
