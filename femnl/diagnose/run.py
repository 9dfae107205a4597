"""From a measurement file to a diagnosis."""

import hashlib
import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from femnl import measurement
from femnl.diagnose.film import SimulatedFilm
from femnl.diagnose.fit import held_out
from femnl.diagnose.problem import Problem
from femnl.diagnose.search import Candidate, applicable, search
from femnl.diagnose.spectrum import SpectrumProblem
from femnl.effects import library
from femnl.errors import MeasurementError
from femnl.geometry import load, parse
from femnl.types.device import Model
from femnl.types.diagnosis import Alternative, Diagnosis, Quality, Trial, Verdict
from femnl.types.effect import Effect
from femnl.types.fit import Parameter

CLEAR = 0.95
"""Posterior probability from which on one set of causes is clearly preferred."""
CONTRADICTED = 1.02
"""Ratio of held-out χ² to that of a rival from which on held-out prediction contradicts the evidence."""
SHOWN = 1e-6
"""Probability below which alternatives are not listed."""
PROBLEMS = {"spectrum": SpectrumProblem}
VERSION = "1.0"


def diagnose(path: str | Path, geometry: str | None = None, effects: Iterable[Effect] | None = None) -> Diagnosis:
    """Say whether the simulation explains a measurement, and if not, which physical cause does.

    Args:
        path: a measurement file, version 1.x.
        geometry: name or path of a geometry to use instead of the file's own.
        effects: the causes to consider; the whole library unless given.

    Returns: the diagnosis, see `measurement-format.md`, "Diagnosis".
    Raises: MeasurementError, GeometryError, ConvergenceError.
    Valid: noise normal, of the standard deviation that the file states or the data show.
    """
    path = Path(path)
    tree = measurement.read(path)
    model = device(tree, path, geometry)
    groups = {name: node.to_dataset() for name, node in tree.children.items()}
    if len(groups) > 1:
        raise MeasurementError(f"{path}: holds {len(groups)} measurements ({', '.join(groups)}); diagnose them one file each")
    ((name, dataset),) = groups.items()
    problem = pose(name, dataset, model)
    pool = applicable(problem, library().values() if effects is None else effects)
    found = search(problem, pool)
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    return conclude(str(path), digest, found, (*tree.attrs.get("repairs", ()), *problem.notes))


def device(tree: xr.DataTree, path: Path, geometry: str | None) -> Model:
    """Return the device that was measured: as asked for, as the file's own text says, or by the name or path in the file."""
    if geometry is not None:
        return load(geometry)
    if "model" in tree.attrs:
        return parse(tree.attrs["model"], str(path))
    if "geometry" not in tree.attrs:
        raise MeasurementError(f"{path}: names no geometry; add the attribute geometry, or give --geometry NAME")
    named = str(tree.attrs["geometry"])
    beside = path.parent / named
    return load(str(beside) if beside.suffix == ".toml" and beside.exists() else named)


def pose(name: str, dataset: xr.Dataset, model: Model) -> Problem:
    """Return the problem that a group of a measurement file poses."""
    kind = str(dataset.attrs["kind"])
    if kind not in PROBLEMS:
        raise MeasurementError(f"{name}: a diagnosis of kind {kind!r} is not available; known are {', '.join(PROBLEMS)}")
    count = max(48, 4 * dataset.sizes.get("mode", 0)) if kind == "spectrum" else 16
    return PROBLEMS[kind](dataset, SimulatedFilm(model, count))


def conclude(file: str, digest: str, found: list[Candidate], notes: tuple[str, ...]) -> Diagnosis:
    """Weigh what was fitted and put the verdict together."""
    base, tried = found[0], found[1:]
    weights = np.array([c.weight for c in found])
    shares = np.exp(weights - weights.max())
    shares /= shares.sum()
    share = {c.names: float(s) for c, s in zip(found, shares, strict=True)}
    viable = sorted((c for c in tried if c.viable), key=lambda c: -c.weight)
    verdict, chosen, rivals = _verdict(base, viable)
    best = chosen or base
    problem = base.solution.model.problem
    before = _quality(base)
    after = before if best is base else _quality(best)
    alternatives = [c for c in sorted(tried, key=lambda c: -c.weight) if c in rivals or (c is not chosen and share[c.names] > SHOWN)]
    if verdict == "ambiguous" and chosen is not None:
        alternatives = [chosen, *alternatives]
    total = sum(share[c.names] for c in viable) or 1.0
    probability = {"adequate": base.p_value, "unexplained": 1 - base.p_value}.get(verdict, share[best.names] / total)
    return Diagnosis(
        file=file,
        sha256=digest,
        verdict=verdict,
        causes=best.names if chosen else (),
        probability=float(probability),
        parameters=_parameters(best),
        alternatives=tuple(Alternative(c.names, share[c.names] / total if c in viable else share[c.names]) for c in alternatives),
        p_value=base.p_value,
        where=_where(base, verdict),
        before=before,
        after=after,
        measure_next=_next(problem, verdict, best, rivals),
        trials=tuple(Trial(c.names, c.solution.chi2, c.weight - base.weight, c.p_value, _against(c)) for c in found),
        notes=notes,
        sentences=tuple(effect.sentence for effect in best.solution.model.effects),
    )


def _verdict(base: Candidate, viable: list[Candidate]) -> tuple[Verdict, Candidate | None, list[Candidate]]:
    if len(base.names) == 0 and base.p_value >= 0.01:
        return "adequate", None, []
    if not viable:
        return "unexplained", None, []
    weights = np.array([c.weight for c in viable])
    shares = np.exp(weights - weights.max()) / np.sum(np.exp(weights - weights.max()))
    rivals = [c for c, s in zip(viable[1:], shares[1:], strict=True) if s > (1 - CLEAR) / 2]
    if shares[0] >= CLEAR or not rivals:
        return "explained", viable[0], []
    simplest = min([viable[0], *rivals], key=lambda c: (len(c.names), sum(len(e.parameters) for e in c.solution.model.effects), -c.weight))
    return "ambiguous", simplest, [c for c in [viable[0], *rivals] if c is not simplest]


def _quality(candidate: Candidate) -> Quality:
    return Quality(candidate.solution.chi2 / candidate.solution.degrees, held_out(candidate.solution))


def _against(candidate: Candidate) -> tuple[str, ...]:
    reasons = [f"{name} ends at a bound" for name in candidate.solution.stuck]
    if 0 < candidate.p_value < 1e-3 or candidate.p_value == 0:
        reasons.append(f"leaves a misfit ({candidate.worst})")
    return tuple(reasons)


def _where(base: Candidate, verdict: Verdict) -> str:
    if verdict == "adequate":
        return "no deviation from the base model beyond noise"
    return f"{base.solution.model.problem.describe(base.solution.residuals)}; most telling: {base.worst}"


def _parameters(candidate: Candidate) -> dict[str, dict[str, Parameter]]:
    sd = np.sqrt(np.diag(candidate.solution.covariance))
    found: dict[str, dict[str, Parameter]] = {"base": {}}
    for (owner, knob), value, s in zip(candidate.solution.model.knobs, candidate.solution.vector, sd, strict=True):
        found.setdefault(owner, {})[knob.name] = Parameter(knob.name, float(value), float(s), knob.unit)
    return found


def _next(problem: Problem, verdict: Verdict, best: Candidate, rivals: list[Candidate]) -> str:
    return ""


def record(diagnosis: Diagnosis) -> dict[str, Any]:
    """Return a diagnosis as the object of `diagnosis.json`."""
    return {
        "femnl_diagnosis": VERSION,
        "file": diagnosis.file,
        "sha256": diagnosis.sha256,
        "verdict": diagnosis.verdict,
        "causes": list(diagnosis.causes),
        "probability": diagnosis.probability,
        "parameters": {
            owner: {name: {"value": p.value, "sd": p.sd, "unit": p.unit} for name, p in own.items()}
            for owner, own in diagnosis.parameters.items()
        },
        "alternatives": [{"causes": list(a.causes), "probability": a.probability} for a in diagnosis.alternatives],
        "misfit": {"p_value": diagnosis.p_value, "where": diagnosis.where},
        "before": vars(diagnosis.before),
        "after": vars(diagnosis.after),
        "gain": diagnosis.gain,
        "measure_next": diagnosis.measure_next,
    }


def write(diagnosis: Diagnosis, folder: str | Path) -> None:
    """Write `diagnosis.json` into a folder, which is made where it is missing."""
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "diagnosis.json").write_text(json.dumps(record(diagnosis), ensure_ascii=False, indent=1), encoding="utf-8")
