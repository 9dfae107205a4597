"""Published measurements, the cause that their authors give, and what femnl says of them."""

from femnl.published.case import Case, external, find, load, to_measurement
from femnl.published.outcome import Outcome, compare, record, render, run

__all__ = [
    "Case",
    "Outcome",
    "compare",
    "external",
    "find",
    "load",
    "record",
    "render",
    "run",
    "to_measurement",
]
