"""The draws of the blind study and what is kept of each.

Pure functions of a job, whatever runs them.
"""

import tempfile
import time
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from femnl.core.fit import Parameter
from femnl.diagnose import diagnose
from femnl.effects import library
from tests.blind.lab import GEOMETRIES, KINDS, STRONG, WEAK, Case, causes, make
from tests.blind.lab.maps import WAVELENGTH

NULLS = 10
"""Files without a cause in every round, for each kind."""
PAIRS = 4
"""Pairs of causes in every round, for each kind."""
TURNS = {"lasers": 3, "device": 3}
"""Rounds in which files of several measurements, which take long to diagnose, hide every cause
once; with one null and one pair each.
"""
TIED = {
    frozenset(("stress_anisotropy", "aspect_ratio")),
    frozenset(("bending_stiffness", "hole_dispersion")),
}
"""Pairs that are one cause to frequencies, never hidden together."""
TURNING = ("aspect_ratio", "shear_stress", "stress_anisotropy")
"""Causes that only differ in direction, which a hexagon does not know."""
UNTOLD = {
    "added_mass": ("x", "y"),
    "beating_pair": ("in_phase", "quadrature"),
    "duffing_shift": ("shift",),
    "energy_exchange": ("threshold",),
    "feed_through": ("in_phase", "quadrature"),
    "working_point": ("phase", "turn"),
    "doublet": ("partner", "in_phase", "quadrature"),
    "fano_background": ("real", "imag"),
    "internal_resonance": ("order", "offset"),
    "lock_in_filter": ("poles",),
    "sloping_background": ("real", "imag"),
    "mechanical_overtones": ("cos2", "sin2", "cos3", "sin3"),
    "mode_admixture": ("e1", "e2", "e3", "e4", "q1", "q2", "q3", "q4"),
    "shear_stress": ("shear",),
    "tension_gradient": ("slope_x", "slope_y"),
}
"""Parameters that data give only up to a symmetry of the film or the sign of a mode, that are no
numbers but choices, or that count from where the data respond."""
FRINGE = {"multilayer_fringe.gap": WAVELENGTH / 2}
"""Parameters that data give only up to a multiple of this."""
TURNED = (
    "phase_tilt.slope_x",
    "phase_tilt.slope_y",
    "quadratic_stiffness.kappa2",
    "static_bow.depth",
)
"""Parameters that change their sign with the motion, of which a diagnosis gives the one within a
quarter turn of the drive.
"""
MIRRORED = {
    "trace": TURNED,
    "response": TURNED,
    "holes": ("stress_anisotropy.anisotropy", "aspect_ratio.elongation"),
    "spectrum": ("clamp_loss.dipole",),
}
"""Parameters whose sign no datum of a kind tells: a mode turned over moves alike, x and y of a
square without labels are one, and a dipole counts by its square.
"""
BASE = {
    "spectrum": ("speed",),
    "holes": (),  # the laboratory's film is 1e-6 too stiff for that, alike for all modes
    "response": ("frequency", "linewidth"),
    "map": ("amplitude", "x", "y"),
    "series": ("frequency",),
    "trace": ("contrast", "amplitude[0]"),
    "record": ("frequency", "linewidth", "stiffness", "alpha"),
    "decay": ("decay_rate",),
    "lasers": ("amplitude", "red.x", "red.y", "green.x", "green.y"),
    "device": ("spectrum.speed", "response.frequency", "response.linewidth"),
}
"""Base parameters that mean the same to the laboratory and to a diagnosis."""


@dataclass(frozen=True)
class Job:
    """One draw: null, hidden, weakened, pair or removed.

    a removed cause is in the same file as the hidden one of its round.
    """

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
        return (
            f"{self.case.kind} {self.case.geometry} {'+'.join(self.case.causes)} {size} "
            f"{self.round} {self.case.seed}"
        )


def jobs(seed: int, rounds: int, kinds: tuple[str, ...] = tuple(KINDS)) -> list[Job]:
    """Return every draw, round by round, so that a part of the study is a fair one."""
    found = []
    for k in range(rounds):
        for kind in kinds:
            everything = causes(kind)
            turns = TURNS.get(kind, 1)
            own = everything[k % turns :: turns]
            rng = np.random.default_rng([seed, k, *kind.encode()])
            pairs = [p for p in combinations(everything, 2) if frozenset(p) not in TIED]
            geometries = GEOMETRIES[kind]
            nulls, drawn_pairs = (1, 1) if turns > 1 else (NULLS, PAIRS)
            chosen = rng.choice(len(pairs), min(drawn_pairs, len(pairs)), replace=False)
            whole: list[tuple[str, tuple[str, ...], tuple[float, float], int]] = [
                ("null", (), STRONG, n) for n in range(nulls)
            ]
            whole += [("hidden", (cause,), STRONG, 0) for cause in own] + [
                ("weakened", (cause,), WEAK, 0) for cause in own
            ]
            whole += [("removed", (cause,), STRONG, 0) for cause in own]
            whole += [("pair", tuple(pairs[i]), STRONG, 0) for i in chosen]
            for task, hidden, size, n in whole:
                geometry = geometries[(k + n) % len(geometries)]
                alike = (
                    geometry == "hexagon-278um" and sum(cause in TURNING for cause in hidden) > 1
                )
                if not alike and all((cause, geometry) not in IMPOSSIBLE for cause in hidden):
                    drawn = zlib.crc32(f"{seed} {k} {n} {kind} {hidden} {size}".encode())
                    found.append(Job(task, Case(kind, hidden, drawn, geometry, size), k))
    return found


PAIRED = ("square-270um", "hexagon-278um", "perforated")
"""Geometries whose modes come in pairs of one frequency."""
IMPOSSIBLE = {
    # the overtone meets a degenerate pair there, of which any combination may answer
    ("mechanical_overtones", "hexagon-278um"),
    # the film of that geometry is assumed, so that its bending length is fitted freely
    ("bending_stiffness", "hexagon-278um"),
    ("yielding_edge", "hexagon-278um"),
    ("compliant_clamp", "hexagon-278um"),  # the laboratory's edge gives way on rectangles alone
    ("multilayer_fringe", "perforated"),  # that geometry has no stack
    # the laboratory's gas moves under and over rectangles alone, and not through holes
    ("gas_loading", "hexagon-278um"),
    # what the chip makes of pairs of one frequency is not resolved
    *((name, geometry) for name in ("clamp_loss", "frame_mode") for geometry in PAIRED),
    ("finite_spot", "perforated"),  # over a hole there is no film that a spot could average
}


def run(job: Job) -> dict[str, Any]:
    """Make the file of a job, diagnose it, and return what the scoreboard needs."""
    gone = set(job.case.causes) if job.task == "removed" else set()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "file.nc"
        truth = make(job.case, path)
        start = time.perf_counter()
        found = diagnose(
            path, effects=[effect for effect in library().values() if effect.name not in gone]
        )
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
        "pulls": pulls_of(job.case, truth, found.parameters)
        if sorted(found.causes) == sorted(job.case.causes)
        else {},
        "trials": [
            [list(t.causes), t.chi2, t.log_evidence, t.p_value, list(t.against)]
            for t in found.trials[:40]
        ],
        "seconds": seconds,
    }


def pulls_of(
    case: Case,
    truth: dict[str, Any],
    found: Mapping[str, Mapping[str, Parameter]],
    exact: bool = True,
) -> dict[str, float]:
    """(value − truth)/sd of every parameter that can be compared.

    Parameters of one laser or measurement by their last name. Where equations are not exact, what
    their accuracy adds is in the sd.
    """
    known = {("base", name): truth["base"][name] for name in BASE[case.kind]}
    for cause, values in truth["causes"].items():
        known |= {
            (cause, name): value
            for name, value in values.items()
            if name not in UNTOLD.get(cause, ())
        }
    turn = np.sign(np.cos(truth["base"].get("phase", truth["base"].get("red.phase", 0.0))))
    pulls = {}
    if case.kind == "decay":
        # It counts in the amplitude where the compared part begins
        known.pop(("nonlinear_damping", "eta"), None)
    if "compliant_clamp" in truth["causes"]:
        # What it does to all modes alike, a diagnosis leaves in the speed
        known.pop(("base", "speed"), None)
    for (owner, spec), value in known.items():
        for name, fitted in found.get(owner, {}).items():
            if name != spec and not (owner != "base" and name.endswith(f".{spec}")):
                continue
            whole = f"{owner}.{spec}"
            if whole in FRINGE and case.kind == "trace":
                # Without a drive, the other side of an extremum of the reflection is as good
                continue
            away = fitted.value - value
            if whole in MIRRORED.get(case.kind, ()):
                away = abs(fitted.value) - abs(value)
            elif whole in TURNED:
                away = fitted.value - turn * value
            if whole in FRINGE:
                away -= FRINGE[whole] * round(away / FRINGE[whole])
            if fitted.sd > 0:
                pulls[f"{owner}.{name}"] = away / (fitted.sd if exact else fitted.whole_sd)
    return pulls
