"""Records: drive and output of one oscillator in volts, sampled in time."""

from typing import Any

from femnl.core.kinds import Cost, KindSpec, Size


def is_record(dataset: Any) -> bool:
    """Return whether a trace holds its drive and no wavelength: a record of one oscillator."""
    return "wavelength" not in dataset.attrs and "drive_voltage" in dataset


KIND = KindSpec(
    name="record",
    of="trace",
    recognise=is_record,
    stages=("equation",),
    scales=frozenset(("curvature", "curvature_square", "slope")),
    pose="femnl.fits.record.pose:pose",
    figure="femnl.plot.traces:trace_figure",
    needs_device=False,
    size=Size(
        data="samples",
        remedy="cut the record, or keep every second sample",
        show=Cost(5.0),
        fit=Cost(50.0, 5_000_000),
        diagnose=Cost(65.0, 1_500_000),
    ),
)
