"""Harmonic maps: complex amplitudes of each harmonic over the film."""

from femnl.core.kinds import AMPLITUDE, NOISE, WAVELENGTH, Contract, Cost, Item, KindSpec, Size

KIND = KindSpec(
    name="map",
    stages=("placement", "motion", "fringe", "harmonics"),
    scales=frozenset(("film", "period", "reach", "slope", "stack", "time", "wavelength")),
    pose="femnl.fits.map.pose:pose",
    figure="femnl.plot.maps:harmonic_map_figure",
    places=True,
    contract=Contract(
        dims=("harmonic", "y", "x"),
        datasets={
            **{
                part: Item(("harmonic", "y", "x"), unit, required=True)
                for part, unit in AMPLITUDE.items()
            },
            "x": Item(("x",), "m", required=True, coordinate=True, axis=True),
            "y": Item(("y",), "m", required=True, coordinate=True, axis=True),
            "time": Item(("y", "x"), "s", coordinate=True),
            "harmonic": Item(("harmonic",), "", required=True, coordinate=True, axis=True),
        },
        attributes={
            "noise_sd": NOISE,
            "wavelength": WAVELENGTH,
            "drive": Item(unit="V"),
            "drive_frequency": Item(unit="Hz", positive=True),
        },
    ),
    size=Size(
        data="pixels of all harmonics",
        remedy="leave out harmonics, or keep every second pixel of each axis",
        show=Cost(8.0),
        fit=Cost(75.0, 10_000_000),
        diagnose=Cost(2400.0, 300_000),
        together=True,
    ),
)
