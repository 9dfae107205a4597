"""What the blind study says: rates with binomial intervals, the confusion matrix, and the limits of detection."""

from collections import defaultdict
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import minimize
from scipy.stats import binomtest, kstest

from femnl.plot.style import COLOURS, new_figure, style

Record = dict[str, Any]
DETECTABLE = 5.0
"""σ by which each cause must stand out to be counted on."""
TOLD = 1e-3
"""Probability from which on an alternative counts as told."""
FOUND = 0.95
"""Share of draws in which the limit of detection is found."""
FEWEST = 20
"""Draws below which no limit of detection is told."""
TARGETS = {
    "false alarms": ("at most", 0.02),
    "cause named": ("at least", 0.97),
    "pair named": ("at least", 0.90),
    "wrong cause explained": ("at most", 0.01),
    "removed cause unexplained": ("at least", 0.95),
    "68 % intervals hold": ("within", 0.68),
    "gain within 10 % of the best": ("at least", 0.95),
}


def told(record: Record) -> bool:
    """Whether the answer is the right set of causes, alone or among equals."""
    if record["verdict"] == "explained":
        return bool(record["named"] == record["causes"])
    others = [names for names, probability in record["alternatives"] if probability > TOLD]
    return record["verdict"] == "ambiguous" and record["causes"] in [record["named"], *others]


def detectable(record: Record) -> bool:
    """Whether every hidden cause stands out."""
    return all(sigma >= DETECTABLE for sigma in record.get("sigma", {}).values())


def tied(record: Record, partners: dict[str, Record]) -> bool:
    """Whether the answer without the true cause is one that, with it, was told as its equal."""
    with_it = partners.get(record["file"])
    return with_it is not None and with_it["verdict"] == "ambiguous" and told(with_it) and record["verdict"] in ("explained", "ambiguous")


def score(records: list[Record], seed: int) -> dict[str, Any]:
    """Return every rate with its 95 % interval (Clopper and Pearson), overall and by kind."""
    good = [r for r in records if "error" not in r]
    by_task: dict[str, list[Record]] = defaultdict(list)
    for record in good:
        by_task[record["task"]].append(record)
    partners = {r["file"]: r for r in by_task["hidden"]}
    strong = {task: [r for r in rows if detectable(r)] for task, rows in by_task.items()}
    caused = [r for task in ("hidden", "weakened", "pair", "removed") for r in by_task[task]]
    measured = [r for r in by_task["hidden"] + by_task["pair"] if r["best_gain"] and r["verdict"] == "explained"]
    pulls = [(r, pull) for r in good for pull in r["pulls"].values()]
    rates: dict[str, tuple[Iterable[Any], Callable[[Any], bool]]] = {
        "false alarms": (by_task["null"], lambda r: r["verdict"] != "adequate"),
        "cause named": (strong.get("hidden", []) + strong.get("weakened", []), told),
        "cause named alone": (strong.get("hidden", []) + strong.get("weakened", []), lambda r: told(r) and r["verdict"] == "explained"),
        "pair named": (strong.get("pair", []), told),
        "wrong cause explained": (
            caused,
            lambda r: r["verdict"] == "explained" and r["named"] != r["causes"] and not (r["task"] == "removed" and tied(r, partners)),
        ),
        "removed cause unexplained": (strong.get("removed", []), lambda r: r["verdict"] == "unexplained" or tied(r, partners)),
        "68 % intervals hold": (pulls, lambda pair: abs(pair[1]) < 1),
        "gain within 10 % of the best": (measured, lambda r: r["gain"] > 0.9 * r["best_gain"]),
    }
    board: dict[str, Any] = {"seeds": [seed], "draws": len(records), "failed": len(records) - len(good), "rates": {}}
    for name, (rows, hit) in rates.items():
        whole = list(rows)
        entry = _rate([hit(row) for row in whole])
        kinds = sorted({(row[0] if isinstance(row, tuple) else row)["kind"] for row in whole})
        parts = {k: [row for row in whole if (row[0] if isinstance(row, tuple) else row)["kind"] == k] for k in kinds}
        entry["by_kind"] = {kind: _rate([hit(row) for row in part]) for kind, part in parts.items()}
        board["rates"][name] = entry | ({"target": list(TARGETS[name])} if name in TARGETS else {})
    p_values = [r["p_value"] for r in by_task["null"]]
    if p_values:
        board["p_value_uniform"] = {"n": len(p_values), "ks_p_value": float(kstest(p_values, "uniform").pvalue)}
    board["limits"] = {name: limit for name, limit in _limits(good).items() if limit is not None}
    board["seconds"] = {
        kind: {"median": float(np.median(own)), "largest": float(np.max(own))}
        for kind in sorted({r["kind"] for r in good})
        for own in [[r["seconds"] for r in good if r["kind"] == kind]]
    }
    return board


def _rate(hits: list[bool]) -> dict[str, Any]:
    n, k = len(hits), sum(hits)
    if n == 0:
        return {"n": 0, "k": 0}
    low, high = binomtest(k, n).proportion_ci()
    return {"n": n, "k": k, "rate": k / n, "interval": [float(low), float(high)]}


def _alone(records: list[Record]) -> dict[str, list[Record]]:
    found = defaultdict(list)
    for record in records:
        if record["task"] in ("hidden", "weakened"):
            found[f"{record['kind']}: {record['causes'][0]}"].append(record)
    return dict(sorted(found.items()))


def _limits(records: list[Record]) -> dict[str, dict[str, float] | None]:
    """σ, and strength in units of the cause, at which a logistic curve through the draws reaches the share found."""
    found: dict[str, dict[str, float] | None] = {}
    for name, rows in _alone(records).items():
        cause = rows[0]["causes"][0]
        sigma = np.array([r["sigma"][cause] for r in rows])
        hit = np.array([told(r) for r in rows], float)
        limit = _logistic(np.log(sigma), hit)
        entry = None if limit is None else {"sigma": limit, "draws": len(rows)}
        if entry is not None:
            strongest = [max(r["truth"][cause].items(), key=lambda item: abs(item[1])) for r in rows]
            if len({knob for knob, _ in strongest}) == 1:
                per = np.median([abs(value) / s for (_, value), s in zip(strongest, sigma, strict=True)])
                entry[strongest[0][0]] = float(per * entry["sigma"])
        found[name] = entry
    return found


def _logistic(x: np.ndarray[Any, Any], hit: np.ndarray[Any, Any]) -> float | None:
    """Return exp(x) where a + b x, fitted by likelihood with a weak prior on its steepness, says `FOUND`."""
    if hit.min() == hit.max() or len(hit) < FEWEST:
        return None

    def cost(v: np.ndarray[Any, Any]) -> float:
        t = np.exp(v[1]) * (x - v[0])
        return float(np.sum(np.logaddexp(0, np.where(hit > 0, -t, t))) + 0.5 * (v[1] - 1.5) ** 2 + 0.02 * v[0] ** 2)

    best = minimize(cost, np.array([1.0, 1.5]), method="Nelder-Mead")
    return float(np.exp(best.x[0] + np.log(FOUND / (1 - FOUND)) / np.exp(best.x[1])))


def draw(records: list[Record], folder: Path) -> None:
    """Write confusion.png, detection.png and p_values.png."""
    good = [r for r in records if "error" not in r]
    with style():
        _confusion(good).savefig(folder / "confusion.png")
        _detection(good).savefig(folder / "detection.png")
        _uniform(good).savefig(folder / "p_values.png")


def _confusion(records: list[Record]) -> Any:
    rows = [r for r in records if r["task"] in ("hidden", "null") and detectable(r)]
    names = sorted({(r["causes"] or ["none"])[0] for r in rows} | {n for r in rows if len(r["named"]) == 1 for n in r["named"]} - {"none"})
    names = [*[n for n in names if n != "none"], "none"]
    columns = [*names[:-1], "several", "tie with it", "tie without it", "unexplained", "adequate"]
    table = np.zeros((len(names), len(columns)))
    for r in rows:
        answer = {"unexplained": "unexplained", "adequate": "adequate"}.get(r["verdict"], "several")
        if r["verdict"] == "ambiguous":
            answer = "tie with it" if told(r) else "tie without it"
        elif r["verdict"] == "explained" and len(r["named"]) == 1:
            answer = r["named"][0]
        table[names.index((r["causes"] or ["none"])[0]), columns.index(answer)] += 1
    share = table / np.maximum(table.sum(axis=1, keepdims=True), 1)
    figure = new_figure(height=0.2 * len(names) + 1.6)
    axes = figure.add_subplot()
    axes.imshow(share, cmap="Blues", vmin=0, vmax=1, aspect="auto")
    for (i, j), n in np.ndenumerate(table):
        if n:
            axes.text(j, i, f"{n:.0f}", ha="center", va="center", fontsize=6.5, color="white" if share[i, j] > 0.6 else "#333333")
    axes.set_xticks(range(len(columns)), [c.replace("_", " ") for c in columns], rotation=90)
    axes.set_yticks(range(len(names)), [n.replace("_", " ") for n in names])
    axes.set_xlabel("answer of the diagnosis")
    axes.set_ylabel("hidden cause")
    return figure


def _detection(records: list[Record]) -> Any:
    alone, limits = _alone(records), _limits(records)
    figure = new_figure(height=0.24 * len(alone) + 1.0)
    axes = figure.add_subplot()
    for y, (name, rows) in enumerate(alone.items()):
        cause = rows[0]["causes"][0]
        for hit, colour in ((True, COLOURS[0]), (False, COLOURS[1])):
            at = [r["sigma"][cause] for r in rows if told(r) == hit]
            axes.plot(at, np.full(len(at), y), "|", color=colour, markersize=6)
        limit = limits[name]
        if limit is not None:
            axes.plot([limit["sigma"]], [y], "k^", markersize=4)
    axes.plot([], [], "|", color=COLOURS[0], label="named")
    axes.plot([], [], "|", color=COLOURS[1], label="not named")
    axes.plot([], [], "k^", label=f"named in {FOUND:.0%}")
    axes.axvline(DETECTABLE, color="#999999", linewidth=0.7)
    axes.set_xscale("log")
    axes.set_yticks(range(len(alone)), [name.replace("_", " ") for name in alone])
    axes.set_ylim(len(alone) - 0.4, -0.6)
    axes.set_xlabel("size of the effect in the data, in σ")
    figure.legend(loc="outside upper center", ncols=3)
    return figure


def _uniform(records: list[Record]) -> Any:
    figure = new_figure(width=3.5, height=3.0)
    axes = figure.add_subplot()
    for k, kind in enumerate(sorted({r["kind"] for r in records})):
        p = np.sort([r["p_value"] for r in records if r["task"] == "null" and r["kind"] == kind])
        axes.plot(p, (np.arange(len(p)) + 0.5) / max(len(p), 1), drawstyle="steps-mid", color=COLOURS[k], label=kind)
    axes.plot([0, 1], [0, 1], color="#999999", linewidth=0.7)
    axes.set_xlabel("p-value of the base model")
    axes.set_ylabel("share of files without a cause")
    axes.legend()
    return figure
