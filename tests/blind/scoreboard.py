"""What the blind study says.

Rates with binomial intervals, the confusion matrix, and the limits of detection.

Run `python -m tests.blind.scoreboard OUT STUDY … [--note WORDS]` to score the records of several
studies as one.
"""

import json
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import kstest

from femnl.plot.style import COLOURS, new_figure, style
from femnl.report.scores import DETECTABLE, confusion_figure, detection_figure
from tests.blind.counts import NAMING, by_cause, confusion, detection, limits, rate
from tests.blind.lab import KINDS
from tests.blind.records import read_studies

Record = dict[str, Any]
TOLD = 1e-3
"""Probability from which on an alternative counts as told."""
TARGETS = {
    "false alarms": ("at most", 0.02),
    "cause named": ("at least", 0.97),
    "pair named": ("at least", 0.90),
    "wrong cause explained": ("at most", 0.01),
    "removed cause unexplained": ("at least", 0.95),
    "68 % intervals hold": ("within", 0.68),
    "gain within 10 % of the best": ("at least", 0.95),
}


WORDS = {
    "false alarms": "false alarms on files without a cause",
    "cause named": "cause named, alone or among equals",
    "pair named": "both of two causes named",
    "wrong cause explained": "wrong set called `explained` or `explained in part`",
    "wrong cause explained, 5σ worse than the truth": "the same, but for what fits less than 5σ "
    "worse than a cause "
    "that the "
    "library lacks",
    "removed cause unexplained": "cause that the library lacks called `unexplained`, or a tie",
    "removed cause unexplained, or told by another within 5σ": "the same, or told by what fits "
    "less than 5σ worse",
    "68 % intervals hold": "68 % intervals that hold the truth",
    "gain within 10 % of the best": "gain within 10 % of that with the true cause known",
}
"""Rates as the table for README says them."""


def told(record: Record) -> bool:
    """Whether the answer is the right set of causes, alone or among equals."""
    if record["verdict"] in NAMING:
        return bool(record["named"] == record["causes"])
    others = [names for names, probability in record["alternatives"] if probability > TOLD]
    return record["verdict"] == "ambiguous" and record["causes"] in [record["named"], *others]


def detectable(record: Record) -> bool:
    """Whether every hidden cause stands out."""
    return all(sigma >= DETECTABLE for sigma in record.get("sigma", {}).values())


def wrong(record: Record) -> bool:
    """Whether an explanation names a cause that is not there or lacks one that stands out."""
    if record["verdict"] not in NAMING:
        return False
    lacking = [cause for cause in record["causes"] if cause not in record["named"]]
    return not set(record["named"]) <= set(record["causes"]) or any(
        record["sigma"][cause] >= DETECTABLE for cause in lacking
    )


def tied(record: Record, partners: dict[str, Record]) -> bool:
    """Whether the answer without the true cause is one that, with it, was told as its equal."""
    with_it = partners.get(record["file"])
    return (
        with_it is not None
        and with_it["verdict"] == "ambiguous"
        and told(with_it)
        and record["verdict"] in (*NAMING, "ambiguous")
    )


def beside(record: Record, partners: dict[str, Record]) -> bool:
    """Whether the answer without the true cause leaves less than 5σ more than the fit with it.

    No one could have told.
    """
    with_it = partners.get(record["file"])
    if with_it is None or record["verdict"] == "unexplained":
        return False
    left = {
        tuple(sorted(names)): chi2 for names, chi2, *_ in [*with_it["trials"], *record["trials"]]
    }
    answer = left.get(tuple(record["named"]))
    truth = left.get(tuple(record["causes"]))
    return answer is not None and truth is not None and answer - truth < DETECTABLE**2


def score(records: list[Record], seeds: Sequence[int]) -> dict[str, Any]:
    """Return every rate with its 95 % interval (Clopper and Pearson), overall and by kind."""
    good = [r for r in records if "error" not in r]
    by_task: dict[str, list[Record]] = defaultdict(list)
    for record in good:
        by_task[record["task"]].append(record)
    partners = {r["file"]: r for r in by_task["hidden"]}
    strong = {task: [r for r in rows if detectable(r)] for task, rows in by_task.items()}
    caused = [r for task in ("hidden", "weakened", "pair", "removed") for r in by_task[task]]
    measured = [
        r
        for r in by_task["hidden"] + by_task["pair"]
        if r["best_gain"] and r["verdict"] == "explained"
    ]
    pulls = [(r, pull) for r in good for pull in r["pulls"].values()]
    rates: dict[str, tuple[Iterable[Any], Callable[[Any], bool]]] = {
        "false alarms": (by_task["null"], lambda r: r["verdict"] != "adequate"),
        "cause named": (strong.get("hidden", []) + strong.get("weakened", []), told),
        "cause named alone": (
            strong.get("hidden", []) + strong.get("weakened", []),
            lambda r: told(r) and r["verdict"] in NAMING,
        ),
        "pair named": (strong.get("pair", []), told),
        "wrong cause explained": (
            caused,
            lambda r: wrong(r) and not (r["task"] == "removed" and tied(r, partners)),
        ),
        "wrong cause explained, 5σ worse than the truth": (
            caused,
            lambda r: (
                wrong(r)
                and not (r["task"] == "removed" and (tied(r, partners) or beside(r, partners)))
            ),
        ),
        "removed cause unexplained": (
            strong.get("removed", []),
            lambda r: r["verdict"] == "unexplained" or tied(r, partners),
        ),
        "removed cause unexplained, or told by another within 5σ": (
            strong.get("removed", []),
            lambda r: r["verdict"] == "unexplained" or tied(r, partners) or beside(r, partners),
        ),
        "68 % intervals hold": (pulls, lambda pair: abs(pair[1]) < 1),
        "gain within 10 % of the best": (measured, lambda r: r["gain"] > 0.9 * r["best_gain"]),
    }
    board: dict[str, Any] = {
        "seeds": [*seeds],
        "draws": len(records),
        "failed": len(records) - len(good),
        "rates": {},
    }
    for name, (rows, hit) in rates.items():
        whole = list(rows)
        entry = rate([hit(row) for row in whole])
        kinds = sorted({(row[0] if isinstance(row, tuple) else row)["kind"] for row in whole})
        parts = {
            k: [row for row in whole if (row[0] if isinstance(row, tuple) else row)["kind"] == k]
            for k in kinds
        }
        entry["by_kind"] = {kind: rate([hit(row) for row in part]) for kind, part in parts.items()}
        board["rates"][name] = entry | ({"target": list(TARGETS[name])} if name in TARGETS else {})
    p_values = [r["p_value"] for r in by_task["null"]]
    if p_values:
        board["p_value_uniform"] = _uniformity(p_values) | {
            "by_kind": {
                k: _uniformity([r["p_value"] for r in by_task["null"] if r["kind"] == k])
                for k in sorted({r["kind"] for r in by_task["null"]})
            }
        }
    clear = [r for r in by_task["hidden"] + by_task["null"] if detectable(r)]
    board["confusion"] = confusion(clear, told, NAMING)
    lone = by_cause(by_task["hidden"] + by_task["weakened"])
    board["detection"] = detection(lone, told)
    board["limits"] = limits(lone, told)
    board["seconds"] = {
        kind: {"median": float(np.median(own)), "largest": float(np.max(own))}
        for kind in sorted({r["kind"] for r in good})
        for own in [[r["seconds"] for r in good if r["kind"] == kind]]
    }
    return board


def table(board: dict[str, Any]) -> str:
    """Return the rates by kind as a table in Markdown."""
    kinds = [kind for kind in KINDS if kind in board["rates"]["false alarms"]["by_kind"]]
    rows = [["", "all kinds", "95 % interval", *kinds], ["---"] * (len(kinds) + 3)]
    for name, words in WORDS.items():
        whole = board["rates"][name]
        low, high = (100 * side for side in whole["interval"])
        counts = [whole["by_kind"].get(kind, {"k": 0, "n": 0}) for kind in kinds]
        rows.append([words, *(f"{r['k']} of {r['n']}" for r in [whole, *counts])])
        rows[-1].insert(2, f"{low:.1f} … {high:.1f} %")
    uniform = board["p_value_uniform"]
    p_values = [uniform["ks_p_value"], *(uniform["by_kind"][kind]["ks_p_value"] for kind in kinds)]
    rows.append(
        [
            "p-value uniform without a cause (p of Kolmogorov and Smirnov)",
            *(f"{p:.2g}" for p in p_values),
        ]
    )
    rows[-1].insert(2, "")
    return "".join(f"| {' | '.join(row)} |\n" for row in rows)


def _uniformity(p_values: list[float]) -> dict[str, Any]:
    """What Kolmogorov and Smirnov say; kinds that err to either side can look uniform together."""
    return {"n": len(p_values), "ks_p_value": float(kstest(p_values, "uniform").pvalue)}


def draw(board: dict[str, Any], records: list[Record], folder: Path) -> None:
    """Write confusion.png, detection.png and p_values.png."""
    confusion_figure(board["confusion"]).savefig(folder / "confusion.png", dpi=200)
    detection_figure(board["detection"], board["limits"]).savefig(folder / "detection.png", dpi=200)
    with style():
        _uniform([r for r in records if "error" not in r]).savefig(folder / "p_values.png")


def _uniform(records: list[Record]) -> Any:
    figure = new_figure(width=3.5, height=3.0)
    axes = figure.add_subplot()
    for k, kind in enumerate(sorted({r["kind"] for r in records})):
        p = np.sort([r["p_value"] for r in records if r["task"] == "null" and r["kind"] == kind])
        axes.plot(
            p,
            (np.arange(len(p)) + 0.5) / max(len(p), 1),
            drawstyle="steps-mid",
            color=COLOURS[k],
            label=kind,
        )
    axes.plot([0, 1], [0, 1], color="#999999", linewidth=0.7)
    axes.set_xlabel("p-value of the base model")
    axes.set_ylabel("share of files without a cause")
    axes.legend()
    return figure


def main() -> None:
    """Score several studies as one."""
    given = read_studies()
    board = score(given.records, given.seeds)
    board = {"seeds": board.pop("seeds"), **({"note": given.note} if given.note else {}), **board}
    (given.out / "scoreboard.json").write_text(
        json.dumps(board, indent=1, ensure_ascii=False), "utf-8"
    )
    (given.out / "table.md").write_text(table(board), "utf-8")
    draw(board, given.records, given.out)


if __name__ == "__main__":
    main()
