"""Driven responses: sweeps over the frequency of the drive."""

from femnl.core.kinds import (
    AMPLITUDE,
    CONTROLS,
    NOISE,
    WAVELENGTH,
    Contract,
    Cost,
    Item,
    KindSpec,
    Size,
    label,
)

SURROUNDINGS = ("pressure", "temperature", "laser_power", "voltage")
"""Control variables that a sweep may note beside its drive and time."""
KIND = KindSpec(
    name="response",
    stages=("oscillator", "signal", "acquisition"),
    scales=frozenset(
        (
            "curvature",
            "curvature_square",
            "direction",
            "drive_square",
            "frequency",
            "linewidth",
            "linewidth_square",
            "moving",
            "slope",
            "slope_per_span",
            "span",
            "stiffening_square",
            "time",
            "wavelength",
        )
    ),
    pose="femnl.fits.response.pose:pose",
    figure="femnl.plot.response:response_figure",
    contract=Contract(
        dims=("sweep", "point"),
        datasets={
            "frequency": Item(
                ("sweep", "point"), "Hz", required=True, coordinate=True, positive=True
            ),
            **{part: Item(("sweep", "point"), unit) for part, unit in AMPLITUDE.items()},
            "magnitude": Item(("sweep", "point"), "V"),
            "drive": label("sweep", "V"),
            "direction": label("sweep", ""),
            "x": label("sweep", "m"),
            "y": label("sweep", "m"),
            "harmonic": label("sweep", ""),
            "time": label("sweep", "s"),
            "duration": label("sweep", "s"),
            **{name: label("sweep", CONTROLS[name]) for name in SURROUNDINGS},
        },
        needs=(("real", "magnitude"), ("imag", "magnitude")),
        free=("sweep",),
        attributes={"noise_sd": NOISE, "wavelength": WAVELENGTH, "mode": Item(unit=None)},
    ),
    size=Size(
        data="points",
        remedy="average points within a linewidth, or leave out what is far from the resonance",
        show=Cost(35.0),
        fit=Cost(130.0, 1_000_000),
        diagnose=Cost(850.0, 500_000),
    ),
)
