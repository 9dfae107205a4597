"""What the scoreboards of both studies count: rates, answers by cause, and limits of detection."""

from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from scipy.optimize import minimize
from scipy.special import expit, logit
from scipy.stats import binomtest

from femnl.report.scores import FOUND

Record = dict[str, Any]
Told = Callable[[Record], bool]
NAMING = ("explained", "explained in part")
"""Verdicts that name causes as the ones."""
LAPSE = 0.01
"""Share of causes of any size that chance alone loses: sets are held to a p-value of a hundredth.
"""
FEWEST = 20
"""Draws below which no limit of detection is told."""


def rate(hits: Sequence[bool]) -> dict[str, Any]:
    """Return how many of how many, and the share with its 95 % interval (Clopper and Pearson)."""
    n = len(hits)
    k = sum(hits)
    if n == 0:
        return {"n": 0, "k": 0}
    low, high = binomtest(k, n).proportion_ci()
    return {"n": n, "k": k, "rate": k / n, "interval": [float(low), float(high)]}


class Events:
    """Events of a study: of each, the kinds of the cases it was counted in, and whether it came."""

    def __init__(self) -> None:
        self._found: dict[str, list[tuple[str, bool]]] = {}

    def count(self, event: str, kind: str, came: bool) -> None:
        """Count one case of an event."""
        self._found.setdefault(event, []).append((kind, came))

    def rates(self, targets: Mapping[str, tuple[str, float]]) -> dict[str, Any]:
        """Return the rate of each event, its target where it has one, and the rates by kind."""
        rates = {}
        for event, cases in self._found.items():
            rates[event] = rate([came for _, came in cases])
            if event in targets:
                rates[event]["target"] = targets[event]
            rates[event]["by_kind"] = {
                kind: rate([came for own, came in cases if own == kind])
                for kind in sorted({own for own, _ in cases})
            }
        return rates


def confusion(records: Iterable[Record], told: Told, naming: Sequence[str]) -> dict[str, Any]:
    """Count how often each hidden cause, or none, got each answer.

    told: whether an answer is the hidden set, alone or among equals. naming: verdicts that name
    causes as the ones. Returns the names of rows and columns, and the counts.
    """
    rows = list(records)
    named = [r["named"][0] for r in rows if _one_cause(r, naming)]
    hidden = [name for r in rows for name in r["causes"]]
    names = [*sorted({*named, *hidden}), "none"]
    other = ["several", "tie with it", "tie without it", "unexplained", "adequate"]
    if any(r["verdict"] in LATE for r in rows):
        other.append("no answer")
    columns = [*names[:-1], *other]
    table = np.zeros((len(names), len(columns)), int)
    for r in rows:
        row = names.index((r["causes"] or ["none"])[0])
        table[row, columns.index(_answer(r, told, naming))] += 1
    return {"hidden": names, "answers": columns, "draws": table.tolist()}


LATE = ("none in time", "error")
"""Verdicts of a study where the diagnosis gave none."""


def _one_cause(record: Record, naming: Sequence[str]) -> bool:
    return record["verdict"] in naming and len(record["named"]) == 1


def _answer(record: Record, told: Told, naming: Sequence[str]) -> str:
    verdict = str(record["verdict"])
    if verdict in LATE:
        return "no answer"
    if verdict == "ambiguous":
        return "tie with it" if told(record) else "tie without it"
    if _one_cause(record, naming):
        return str(record["named"][0])
    return "several" if verdict in naming else verdict


def by_cause(records: Iterable[Record]) -> dict[str, list[Record]]:
    """Return the files that hide one cause, by kind and cause."""
    found = defaultdict(list)
    for record in records:
        if len(record["causes"]) == 1:
            found[f"{record['kind']}: {record['causes'][0]}"].append(record)
    return dict(sorted(found.items()))


def detection(causes: Mapping[str, list[Record]], told: Told) -> dict[str, dict[str, list[float]]]:
    """Return the sizes [σ] of each lone cause in files that named it, and in those that missed it.

    causes: from `by_cause`.
    """
    found: dict[str, dict[str, list[float]]] = {}
    for name, rows in causes.items():
        found[name] = {
            key: sorted(float(f"{_size(r):.3g}") for r in rows if told(r) == hit)
            for key, hit in (("named", True), ("missed", False))
        }
    return found


def limits(causes: Mapping[str, list[Record]], told: Told) -> dict[str, dict[str, float]]:
    """Return the size from which on each lone cause is named in a share `FOUND` of files.

    It is where a logistic curve through the files reaches that share: in σ, and as a strength in
    the unit of the cause. Causes of too few files, or of only one answer, are left out.
    """
    found: dict[str, dict[str, float]] = {}
    for name, rows in causes.items():
        cause = rows[0]["causes"][0]
        sigma = np.array([_size(r) for r in rows])
        limit = _logistic(np.log(sigma), np.array([told(r) for r in rows], float))
        if limit is None:
            continue
        found[name] = {"sigma": limit, "draws": len(rows)}
        strongest = [max(r["truth"][cause].items(), key=lambda item: abs(item[1])) for r in rows]
        if len({parameter for parameter, _ in strongest}) == 1:
            per_sigma = [abs(v) / s for (_, v), s in zip(strongest, sigma, strict=True)]
            found[name][strongest[0][0]] = float(np.median(per_sigma) * limit)
    return found


def _size(record: Record) -> float:
    """Return by how many σ the one hidden cause of a file stands out."""
    return float(record["sigma"][record["causes"][0]])


def _logistic(x: np.ndarray[Any, Any], hit: np.ndarray[Any, Any]) -> float | None:
    """Return exp(x) where the logistic curve says `FOUND`, if there are draws on either side.

    The curve ends at 1 − `LAPSE`.
    """
    if len(hit) < FEWEST or hit.min() == hit.max():
        return None

    # By likelihood, with a weak prior on the steepness.
    def cost(v: np.ndarray[Any, Any]) -> float:
        named = (1 - LAPSE) * expit(np.exp(v[1]) * (x - v[0]))
        return float(
            -np.sum(np.log(np.where(hit > 0, named, 1 - named)))
            + 0.5 * (v[1] - 1.5) ** 2
            + 0.02 * v[0] ** 2
        )

    best = minimize(cost, np.array([1.0, 1.5]), method="Nelder-Mead")
    limit = float(best.x[0] + logit(FOUND / (1 - LAPSE)) / np.exp(best.x[1]))
    return float(np.exp(limit)) if x.min() < limit < x.max() else None
