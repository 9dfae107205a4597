"""Traces: the voltage of a readout in time, at one spot, while a mode is driven."""

from femnl.core.kinds import NOISE, WAVELENGTH, Contract, Cost, Item, KindSpec, Size

KIND = KindSpec(
    name="trace",
    stages=("motion", "fringe", "harmonics"),
    scales=frozenset(("film", "period", "slope", "stack", "wavelength")),
    pose="femnl.fits.trace.pose:pose",
    figure="femnl.plot.traces:trace_figure",
    contract=Contract(
        dims=("step", "time"),
        datasets={
            "voltage": Item(("step", "time"), "V", required=True),
            "drive_voltage": Item(("step", "time"), "V"),
            "time": Item(("time",), "s", required=True, coordinate=True, axis=True),
            "drive_frequency": Item(("step",), "Hz", coordinate=True, positive=True),
        },
        attributes={
            "noise_sd": NOISE,
            "wavelength": WAVELENGTH,
            "x": Item(unit="m"),
            "y": Item(unit="m"),
        },
        needs=(("drive_frequency", "drive_voltage"),),
    ),
    size=Size(
        data="samples",
        remedy="cut the trace to fewer periods, or import fewer steps",
        show=Cost(6.0),
        fit=Cost(85.0),
        diagnose=Cost(815.0, 8_000_000),
    ),
)
