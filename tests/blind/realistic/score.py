"""What the realistic study says: events with 95 % intervals, by kind and by regime.

Run `python -m tests.blind.realistic.score OUT STUDY … [--note WORDS]` to score the records of
several studies as one, and to draw their figures.
"""

import json
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from femnl.report.scores import (
    DETECTABLE,
    SHARE_NEAR,
    confusion_figure,
    detection_figure,
    shares_figure,
)
from tests.blind.counts import NAMING, Record, by_cause, confusion, detection, limits, rate
from tests.blind.realistic.regimes import REGIMES
from tests.blind.records import read_studies

CLEAR = 7.0
"""σ from which on a glitch is to be listed."""
UNSEEN = ("decay",)
"""Kinds in which some glitches are seen by nobody: in a plateau, or in the phase of a power."""
LISTED = 0.9
SPARE = 2
"""Part of the glitches that must be listed, and how many others may be beyond a tenth of them."""
WORDS = {
    "named": "hidden cause named, and nothing else",
    "named alone": "the same, without what is `ambiguous`",
    "wrong name": "a name that is wrong, where something is hidden",
    "false alarm": "nothing hidden: any answer but `adequate`",
    "named nothing": "nothing hidden: a cause named",
    "lacking": "cause that the library lacks given no wrong name",
    "intervals": "68 % intervals that hold the truth",
    "shares": "share within 0.1 of the true one",
    "glitches": "glitches listed",
    "in time": "answer in time",
}
TARGETS = {
    "named": ("at least", 0.95),
    "wrong name": ("at most", 0.01),
    "false alarm": ("at most", 0.02),
    "lacking": ("at least", 0.95),
    "intervals": ("within", 0.68),
}
"""Rates that are asked for, over all regimes."""


def hidden_told(record: Record) -> bool:
    """Whether the answer is the hidden set, alone or among equals."""
    if record["verdict"] in NAMING:
        return bool(record["named"] == record["causes"])
    return record["verdict"] == "ambiguous" and record["causes"] in record["alternatives"]


def wrong(record: Record) -> bool:
    """Whether the answer names a cause that is absent.

    Equals are wrong if no set of them is of hidden causes alone, and where the library lacks the
    cause, if they are no equals of it with the whole library.
    """
    hidden = set(record["causes"])
    tied = [set(names) for names in record.get("equals", [])]
    if hidden in tied and set(record["named"]) in tied:
        return False
    if record["verdict"] in NAMING:
        return not set(record["named"]) <= hidden
    if record["verdict"] == "ambiguous":
        sets = [set(names) for names in record["alternatives"]]
        return not any(names and names <= hidden for names in sets)
    return False


def detectable(record: Record) -> bool:
    """Whether every hidden cause stands out."""
    return all(sigma >= DETECTABLE for sigma in record["sigma"].values())


def near_shares(record: Record) -> list[bool]:
    """Whether each told share of a hidden cause is within a tenth of the true one."""
    return [
        abs(told["share"] - record["shares"][cause]["share"]) <= SHARE_NEAR
        for cause, told in record.get("found_shares", {}).items()
        if cause in record["shares"]
    ]


def share_pairs(record: Record) -> list[dict[str, Any]]:
    """Return true and told share, and its standard deviation, of each right cause."""
    return [
        {
            "cause": f"{record['kind']}: {cause}",
            "sigma": record["sigma"][cause],
            "true": record["shares"][cause]["share"],
            "told": told["share"],
            "sd": told["sd"],
        }
        for cause, told in record.get("found_shares", {}).items()
        if cause in record["shares"]
    ]


def held(record: Record) -> list[bool]:
    """Whether each 68 % interval of a parameter holds the truth."""
    return [bool(abs(pull) < 1) for pull in record.get("pulls", {}).values()]


def listed(record: Record) -> bool:
    """Whether the glitches are left out, and not much else."""
    planted = sum(size >= CLEAR for size in record["glitches"])
    count = len(record.get("excluded", []))
    return bool(LISTED * planted <= count <= (2 - LISTED) * len(record["glitches"]) + SPARE)


def score(records: list[Record], about: dict[str, Any]) -> dict[str, Any]:
    """Return every rate with its interval (Clopper and Pearson): of all, by kind, by regime.

    A file that ended in an error counts as one without the right answer.
    """
    board: dict[str, Any] = about | {
        "draws": len(records),
        "failed": [[r["name"], r["error"]] for r in records if "error" in r],
        "seconds": _seconds(records),
        "rates": {},
    }
    for name, (rows, hit) in _events(records).items():
        kept = [(row, hit(row)) for row in rows]
        hits = [(row, one) for row, found in kept for one in found]
        board["rates"][name] = rate([one for _, one in hits]) | {"words": WORDS[name]}
        if name in TARGETS:
            board["rates"][name]["target"] = list(TARGETS[name])
        for key in ("kind", "regime"):
            board["rates"][name][f"by_{key}"] = _parts(hits, key)
    present = [r for r in records if r["regime"] != "lacking"]
    lone = by_cause(r for r in present if "truth" in r)
    board["confusion"] = confusion((r for r in present if detectable(r)), hidden_told, NAMING)
    board["detection"] = detection(lone, hidden_told)
    board["limits"] = limits(lone, hidden_told)
    board["shares"] = [pair for r in present for pair in share_pairs(r)]
    return board


def _parts(hits: list[tuple[Record, bool]], key: str) -> dict[str, Any]:
    """Return the rate of an event for each value that files have of something."""
    return {
        value: rate([one for row, one in hits if row[key] == value])
        for value in sorted({row[key] for row, _ in hits})
    }


Event = tuple[Iterable[Record], Callable[[Record], list[bool]]]


def _events(good: list[Record]) -> dict[str, Event]:
    """Return, for each event, the files that it may happen in, and how often it did in each."""
    lacking = [r for r in good if r["regime"] in REGIMES and REGIMES[r["regime"]].lacking]
    caused = [r for r in good if r["causes"] and r not in lacking]
    quiet = [r for r in good if not r["causes"]]
    clear = [r for r in caused if detectable(r)]
    return {
        "named": (clear, lambda r: [hidden_told(r)]),
        "named alone": (clear, lambda r: [hidden_told(r) and r["verdict"] in NAMING]),
        "wrong name": (caused, lambda r: [wrong(r)]),
        "false alarm": (quiet, lambda r: [r["verdict"] != "adequate"]),
        "named nothing": (quiet, lambda r: [bool(r["named"])]),
        "lacking": (lacking, lambda r: [not wrong(r)]),
        "intervals": (good, held),
        "shares": (caused, near_shares),
        "glitches": (
            [r for r in good if r["glitches"] and r["kind"] not in UNSEEN],
            lambda r: [listed(r)],
        ),
        "in time": (good, lambda r: [r["verdict"] != "none in time"]),
    }


def _seconds(good: list[Record]) -> dict[str, dict[str, float]]:
    found = {}
    for kind in sorted({r["kind"] for r in good}):
        own = sorted(r["seconds"] for r in good if r["kind"] == kind)
        found[kind] = {"median": own[len(own) // 2], "largest": own[-1], "files": len(own)}
    return found


def table(board: dict[str, Any], by: str = "regime") -> str:
    """Return the rates by kind or by regime as a table in Markdown."""
    known = [*REGIMES] if by == "regime" else [*board["seconds"]]
    columns = [
        name
        for name in known
        if any(name in rate.get(f"by_{by}", {}) for rate in board["rates"].values())
    ]
    rows = [["", "all", "95 % interval", *columns], ["---"] * (len(columns) + 3)]
    for name, words in WORDS.items():
        whole = board["rates"][name]
        cells = [_count(whole.get(f"by_{by}", {}).get(column)) for column in columns]
        rows.append([words, _count(whole), _interval(whole), *cells])
    return "".join(f"| {' | '.join(row)} |\n" for row in rows)


def _count(part: dict[str, Any] | None) -> str:
    return f"{part['k']} of {part['n']}" if part and part["n"] else "–"


def _interval(whole: dict[str, Any]) -> str:
    if not whole["n"]:
        return ""
    low, high = (100 * side for side in whole["interval"])
    return f"{low:.1f} … {high:.1f} %"


def write(board: dict[str, Any], folder: Path) -> None:
    """Write scoreboard.json, table.md by regime and by kind, and three figures."""
    (folder / "scoreboard.json").write_text(
        json.dumps(board, indent=1, ensure_ascii=False), encoding="utf-8"
    )
    tables = [table(board, by) for by in ("regime", "kind")]
    (folder / "table.md").write_text("\n".join(tables), encoding="utf-8")
    confusion_figure(board["confusion"]).savefig(folder / "confusion.png", dpi=200)
    detection_figure(board["detection"], board["limits"]).savefig(folder / "detection.png", dpi=200)
    shares_figure(board["shares"]).savefig(folder / "shares.png", dpi=200)


def main() -> None:
    """Score several studies as one."""
    given = read_studies()
    write(score(given.records, {"seeds": given.seeds, "note": given.note}), given.out)


if __name__ == "__main__":
    main()
