"""What the realistic study says: events with 95 % intervals, by kind and by regime."""

from collections.abc import Callable, Iterable
from typing import Any

from femnl.report.scores import DETECTABLE
from tests.blind.realistic.regimes import REGIMES
from tests.blind.scoreboard import _rate

Record = dict[str, Any]
NAMING = ("explained", "explained in part")
NEAR = 0.1
"""How far a share may be from the true one."""
CLEAR = 7.0
"""σ from which on a glitch is to be listed."""
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
    "exact": 0.97,
    "inexact": 0.95,
    "beside unknown": 0.90,
}
"""Rates of causes named that are asked for."""


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
        abs(told["share"] - record["shares"][cause]["share"]) <= NEAR
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
        "files": len(records),
        "failed": [[r["name"], r["error"]] for r in records if "error" in r],
        "seconds": _seconds(records),
        "rates": {},
    }
    for name, (rows, hit) in _events(records).items():
        kept = [(row, hit(row)) for row in rows]
        hits = [(row, one) for row, found in kept for one in found]
        board["rates"][name] = _rate([one for _, one in hits]) | {
            f"by_{key}": {
                value: _rate([one for row, one in hits if row[key] == value])
                for value in sorted({row[key] for row, _ in hits})
            }
            for key in ("kind", "regime")
        }
    return board


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
        "glitches": ([r for r in good if r["glitches"]], lambda r: [listed(r)]),
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
        rate = board["rates"][name]
        cells = [_count(rate.get(f"by_{by}", {}).get(column)) for column in columns]
        rows.append([words, _count(rate), _interval(rate), *cells])
    return "".join(f"| {' | '.join(row)} |\n" for row in rows)


def _count(rate: dict[str, Any] | None) -> str:
    return f"{rate['k']} of {rate['n']}" if rate and rate["n"] else "–"


def _interval(rate: dict[str, Any]) -> str:
    if not rate["n"]:
        return ""
    low, high = (100 * side for side in rate["interval"])
    return f"{low:.1f} … {high:.1f} %"
