"""The draws of the blind study and what is kept of each: pure functions of a job, whatever runs them."""

import tempfile
import time
import zlib
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from femnl.diagnose import diagnose
from femnl.effects import library
from femnl.types.diagnosis import Diagnosis
from tests.blind.lab import GEOMETRIES, KINDS, STRONG, WEAK, Case, causes, make

NULLS = 3
"""Files without a cause in every round, for each kind."""
PAIRS = 4
"""Pairs of causes in every round, for each kind."""
TIED = {frozenset(("stress_anisotropy", "aspect_ratio"))}
"""Pairs that are one cause to frequencies, never hidden together."""
UNTOLD = {
    "added_mass": ("x", "y"),
    "mechanical_overtones": ("cos2", "sin2", "cos3", "sin3"),
    "mode_admixture": ("e1", "e2", "e3", "e4"),
    "tension_gradient": ("slope_x", "slope_y"),
}
"""Parameters that data give only up to a symmetry of the film or the sign of a mode."""
BASE = {"spectrum": ("speed",), "response": ("frequency", "linewidth"), "map": ("amplitude", "x", "y"), "series": ("frequency",)}
"""Base parameters that mean the same to the laboratory and to a diagnosis."""


@dataclass(frozen=True)
class Job:
    """One draw: null, hidden, weakened, pair or removed; a removed cause is in the same file as the hidden one of its round."""

    task: str
    case: Case
    round: int

    @property
    def name(self) -> str:
        """What tells the job from all others of a study."""
        return f"{self.task} {self.file}"

    @property
    def file(self) -> str:
        """What tells its file from all others."""
        size = "weak" if self.case.size == WEAK else "strong"
        return f"{self.case.kind} {self.case.geometry} {'+'.join(self.case.causes)} {size} {self.round} {self.case.seed}"


def jobs(seed: int, rounds: int, kinds: tuple[str, ...] = tuple(KINDS)) -> list[Job]:
    """Return every draw, round by round, so that a part of the study is a fair one."""
    found = []
    for k in range(rounds):
        for kind in kinds:
            own = causes(kind)
            rng = np.random.default_rng([seed, k, *kind.encode()])
            pairs = [p for p in combinations(own, 2) if frozenset(p) not in TIED]
            geometries = GEOMETRIES[kind]
            whole: list[tuple[str, tuple[str, ...], tuple[float, float], int]] = [("null", (), STRONG, n) for n in range(NULLS)]
            whole += [("hidden", (cause,), STRONG, 0) for cause in own] + [("weakened", (cause,), WEAK, 0) for cause in own]
            whole += [("removed", (cause,), STRONG, 0) for cause in own]
            whole += [("pair", tuple(pairs[i]), STRONG, 0) for i in rng.choice(len(pairs), min(PAIRS, len(pairs)), replace=False)]
            for task, hidden, size, n in whole:
                geometry = geometries[(k + n) % len(geometries)]
                if (hidden, geometry) not in IMPOSSIBLE:
                    drawn = zlib.crc32(f"{seed} {k} {n} {kind} {hidden} {size}".encode())
                    found.append(Job(task, Case(kind, hidden, drawn, geometry, size), k))
    return found


IMPOSSIBLE: set[tuple[tuple[str, ...], str]] = {(("mechanical_overtones",), "hexagon-278um")}
"""The overtone meets a degenerate pair there, of which any combination may answer."""


def run(job: Job) -> dict[str, Any]:
    """Make the file of a job, diagnose it, and return what the scoreboard needs."""
    gone = set(job.case.causes) if job.task == "removed" else set()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "file.nc"
        truth = make(job.case, path)
        start = time.perf_counter()
        found = diagnose(path, effects=[effect for effect in library().values() if effect.name not in gone])
        seconds = time.perf_counter() - start
        best = None
        if job.task in ("hidden", "pair") and found.verdict != "adequate":
            best = diagnose(path, effects=[library()[name] for name in job.case.causes]).gain
    return {
        "name": job.name,
        "task": job.task,
        "file": job.file,
        "kind": job.case.kind,
        "geometry": job.case.geometry,
        "causes": sorted(job.case.causes),
        "sigma": truth["sigma"],
        "truth": truth["causes"],
        "seed": job.case.seed,
        "round": job.round,
        "verdict": found.verdict,
        "named": sorted(found.causes),
        "alternatives": [[sorted(a.causes), a.probability] for a in found.alternatives],
        "p_value": found.p_value,
        "gain": found.gain,
        "best_gain": best,
        "before": found.before.chi2_reduced,
        "after": found.after.chi2_reduced,
        "pulls": _pulls(job.case, truth, found) if sorted(found.causes) == sorted(job.case.causes) else {},
        "trials": [[list(t.causes), t.chi2, t.log_evidence, t.p_value, list(t.against)] for t in found.trials[:40]],
        "seconds": seconds,
    }


def _pulls(case: Case, truth: dict[str, Any], found: Diagnosis) -> dict[str, float]:
    """(value − truth)/sd of every parameter that can be compared."""
    known = {f"base.{name}": truth["base"][name] for name in BASE[case.kind]}
    for cause, values in truth["causes"].items():
        known |= {f"{cause}.{name}": value for name, value in values.items() if name not in UNTOLD.get(cause, ())}
    pulls = {}
    for name, value in known.items():
        owner, knob = name.split(".")
        fitted = found.parameters.get(owner, {}).get(knob)
        if fitted is not None and fitted.sd > 0:
            pulls[name] = (fitted.value - value) / fitted.sd
    return pulls
