"""Series: frequency and quality factor of one mode against control variables."""

from femnl.core.kinds import CONTROLS, Contract, Cost, Item, KindSpec, Size, label

_RECORDED = (*CONTROLS, "frequency", "quality_factor")

KIND = KindSpec(
    name="series",
    stages=("points",),
    scales=frozenset(
        (
            *_RECORDED,
            "electrostatic",
            "crossing_time",
            "gap",
            "gas_loss",
            "highest_pressure",
            "thermal_stress",
            *(f"per_{name}" for name in CONTROLS),
            *(f"per_{name}_square" for name in CONTROLS),
        )
    ),
    pose="femnl.fits.series.pose:pose",
    figure="femnl.plot.measurement:series_figure",
    contract=Contract(
        dims=("point",),
        datasets={
            **{name: label("point", unit) for name, unit in CONTROLS.items()},
            "frequency": Item(("point",), "Hz", positive=True),
            "frequency_sd": Item(("point",), "Hz", positive=True),
            "quality_factor": Item(("point",), "", positive=True),
            "quality_factor_sd": Item(("point",), "", positive=True),
        },
        needs=(tuple(CONTROLS), ("frequency", "quality_factor")),
        free=("point",),
    ),
    size=Size(
        data="points",
        remedy="average neighbouring points",
        show=Cost(50.0),
        fit=Cost(15.0),
        diagnose=Cost(360.0, 4_000_000),
    ),
)
