"""A virtual laboratory: measurement files made without the models that a diagnosis fits.

Films come from sines and from finite elements of another family, order and mesh, responses from
time steps of the slow flow, harmonics from sampled signals and an FFT, fringes of stacks from a
recursion of reflections; instruments round. A file says nothing of what was hidden in it: the truth
is returned apart.
"""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from femnl.io import measurement
from tests.blind.lab import (
    decay,
    electrode,
    holes,
    joint,
    maps,
    record,
    response,
    series,
    spectrum,
    trace,
)
from tests.blind.lab.bench import Bench, Cause, sized
from tests.blind.lab.film import device

STRONG = (6.0, 300.0)
WEAK = (0.7, 8.0)
"""Ranges of σ by which hidden and weakened causes stand out; drawn evenly in the logarithm."""
KINDS: dict[str, Any] = {
    "spectrum": spectrum,
    "holes": holes,
    "electrode": electrode,
    "response": response,
    "map": maps,
    "series": series,
    "trace": trace,
    "record": record,
    "decay": decay,
    "lasers": joint.Lasers,
    "device": joint.Device,
}
"""What is in a file: one measurement (holes, electrode: a spectrum of a film with them), but maps
under two lasers, and spectrum and sweeps.
"""
GEOMETRIES = {
    "spectrum": ("square-270um", "rectangle", "hexagon-278um"),
    "holes": ("perforated",),
    "electrode": ("metallised-drum",),
    "response": ("square-270um",),
    "map": ("square-270um", "rectangle", "hexagon-278um", "perforated"),
    "series": ("square-270um",),
    "trace": ("square-270um",),
    "record": ("square-270um",),
    "decay": ("square-270um",),
    "lasers": ("square-270um", "rectangle"),
    "device": ("square-270um",),
}


@dataclass(frozen=True)
class Case:
    """One file to make.

    Its kind, the causes in it, the device, the range of their sizes in σ, and the seed of all
    else.
    """

    kind: str
    causes: tuple[str, ...]
    seed: int
    geometry: str = "square-270um"
    size: tuple[float, float] = STRONG


def causes(kind: str) -> tuple[str, ...]:
    """Names of the causes that the laboratory can hide in a kind of measurement."""
    return tuple(KINDS[kind].CAUSES)


def make(case: Case, path: Path) -> dict[str, Any]:
    """Write the measurement file of a case and return what is in it.

    Base, causes with values, and by how many σ each stands out.
    """
    rng = np.random.default_rng([case.seed, *case.kind.encode(), *"+".join(case.causes).encode()])
    bench: Bench = KINDS[case.kind].setup(case.geometry, case.causes, rng)
    base = bench.draw(rng)
    hidden = {name: KINDS[case.kind].CAUSES[name](rng, bench) for name in case.causes}
    wanted = {name: float(np.exp(rng.uniform(*np.log(case.size)))) for name in case.causes}
    hidden, found = sized(bench, base, hidden, wanted)
    groups = bench.measured(base, {name: cause.values for name, cause in hidden.items()}, rng)
    measurement.write(
        measurement.bundle(groups, geometry=case.geometry, model=device(case.geometry).text), path
    )
    return {
        "case": asdict(case),
        "base": base,
        "causes": {name: cause.values for name, cause in hidden.items()},
        "sigma": found,
    }


__all__ = ["GEOMETRIES", "KINDS", "STRONG", "WEAK", "Case", "Cause", "causes", "make"]
