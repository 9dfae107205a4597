"""Decays: what is left of a motion after its drive is switched off, with what surrounds it."""

from femnl.core.kinds import Contract, Cost, Item, KindSpec, Size

KIND = KindSpec(
    name="decay",
    stages=("dissipation", "ringing", "reading"),
    scales=frozenset(("curvature", "per_time", "per_time_square", "phase", "rate", "time")),
    pose="femnl.fits.decay.pose:pose",
    figure="femnl.plot.measurement:decay_figure",
    needs_device=False,
    contract=Contract(
        dims=("time",),
        datasets={
            "time": Item(("time",), "s", required=True, coordinate=True, axis=True),
            "power": Item(("time",), "dB"),
            "magnitude": Item(("time",), "V"),
            "real": Item(("time",), "V"),
            "imag": Item(("time",), "V"),
        },
        attributes={
            "frequency": Item(unit="Hz", positive=True),
            "bandwidth": Item(unit="Hz", positive=True),
            "pressure": Item(unit="Pa", positive=True),
            "temperature": Item(unit="K", positive=True),
        },
        needs=(("power", "magnitude", "real"), ("power", "magnitude", "imag")),
    ),
    size=Size(
        data="points",
        remedy="keep fewer points, or the decay alone",
        show=Cost(30.0),
        fit=Cost(30.0, 3_000_000),
        diagnose=Cost(100.0, 1_000_000),
    ),
)
