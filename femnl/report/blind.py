"""The blind study on the page: how often a hidden cause is named, as `make blind` counted it."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from femnl.core.numbers import plain
from femnl.report.picture import Picture, embed
from femnl.report.scores import confusion_figure, detection_figure, shares_figure

NAME = "blind.json"
"""File of the scoreboard beside the validation cases."""
WORDS = {"at most": "≤", "at least": "≥"}
UNIFORM = "uniform p-values without a cause: Kolmogorov and Smirnov's p"
HALF = 0.04
"""How far from its target a rate may lie that should be met from both sides."""


TITLES = {
    "weak": (
        "Weak causes, ideal noise",
        "Files hide no cause, one, two at once, one that the library is made to lack, and one too "
        "weak to see.",
    ),
    "realistic": (
        "Causes as strong as in laboratories, noise as it is",
        "Files hide no cause or one of 3 to 10⁴σ: by the library's law or another, beside "
        "something unknown, with glitches, correlated noise, a wrong standard deviation, a film "
        "as fabricated, or one that the library is made to lack.",
    ),
    "chips": (
        "Chips of many devices",
        "Chips hide no device, one or two that deviate by 5 to 100σ, one that loses more, or two "
        "whose names were exchanged, beside a variation over the chip that is none, a plane, a "
        "bowl, or a wave; a file is a chip.",
    ),
    "odd_devices": (
        "Odd devices of chips, by their modes",
        "Chips of twelve like squares hide one more with a cause of spectra, or with another "
        "stress; a file is a chip.",
    ),
}
"""What each study of a scoreboard hides."""


@dataclass(frozen=True)
class Blind:
    """Rates with their targets, rates by kind, limits of detection in σ, and the figures."""

    title: str
    words: str
    draws: int
    seeds: str
    note: str
    rates: list[list[str]]
    kinds: list[str]
    by_kind: list[list[str]]
    limits: list[list[str]]
    pictures: list[Picture]


def blind(folder: Path) -> list[Blind]:
    """Read the studies of the scoreboard beside the validation cases; none where there is none."""
    path = folder / NAME
    if not path.is_file():
        return []
    boards = json.loads(path.read_text(encoding="utf-8"))
    return [_study(boards[name], *TITLES[name]) for name in TITLES if name in boards]


def _study(board: Mapping[str, Any], title: str, words: str) -> Blind:
    kinds = sorted({kind for rate in board["rates"].values() for kind in rate["by_kind"]})
    counted = {rate.get("words", name): rate for name, rate in board["rates"].items() if rate["n"]}
    by_kind = [
        [name, *(_share(rate["by_kind"].get(kind)) for kind in kinds)]
        for name, rate in counted.items()
    ]
    uniform = board.get("p_value_uniform", {}).get("by_kind", {})
    if uniform:
        p_values = [plain(uniform[k]["ks_p_value"], 2) if k in uniform else "–" for k in kinds]
        by_kind.append([UNIFORM, *p_values])
    return Blind(
        title,
        words,
        board["draws"],
        ", ".join(str(seed) for seed in board["seeds"]),
        board.get("note", ""),
        [
            [name, f"{r['k']} of {r['n']}", _percent(r["rate"]), _interval(r), _target(r)]
            for name, r in counted.items()
        ],
        [kind.replace("_", " ") for kind in kinds],  # causes, which break between words
        by_kind,
        [
            [name, plain(limit["sigma"], 3), str(limit["draws"]), _sizes(limit)]
            for name, limit in board["limits"].items()
        ],
        _pictures(board),
    )


def _pictures(board: Mapping[str, Any]) -> list[Picture]:
    """The figures; those that a scoreboard of an earlier kind has no numbers for are left out."""
    pictures = []
    if "confusion" in board:
        caption = (
            "Answers to files that hide one cause of at least 5σ, or none: how many got which; "
            "colours are shares of the row. A tie names several sets of causes as equals."
        )
        pictures.append(
            embed(
                confusion_figure(board["confusion"]), "Confusion matrix of the blind study", caption
            )
        )
    if "detection" in board:
        caption = (
            "Each lone cause, hidden ever more weakly: its size in draws that named it and in "
            "draws that did not; the line is 5σ."
        )
        figure = detection_figure(board["detection"], board["limits"])
        pictures.append(
            embed(
                figure,
                "Sizes at which the blind study named each cause, and at which it did not",
                caption,
            )
        )
    if "shares" in board:
        caption = (
            "What the diagnosis says that a right cause takes up of the deviation, less what it "
            "does, with the standard deviation told. Shares within the band are 0.1 off or less."
        )
        pictures.append(
            embed(shares_figure(board["shares"]), "Shares told, less the true ones", caption)
        )
    return pictures


def _percent(rate: float) -> str:
    return f"{100 * rate:.3g} %"


def _interval(rate: Mapping[str, Any]) -> str:
    low, high = rate["interval"]
    return f"{100 * low:.3g} … {100 * high:.3g} %"


def _share(rate: Mapping[str, Any] | None) -> str:
    return "–" if rate is None or not rate["n"] else f"{rate['k']} of {rate['n']}"


def _target(rate: Mapping[str, Any]) -> str:
    """Return the target, and whether the interval meets it, misses it, or is too wide to say."""
    if "target" not in rate:
        return "–"
    word, goal = rate["target"]
    low, high = rate["interval"]
    if word == "within":
        return (
            f"{100 * (goal - HALF):.3g} … {100 * (goal + HALF):.3g} %: "
            f"{'met' if abs(rate['rate'] - goal) <= HALF else 'missed'}"
        )
    met, missed = (high <= goal, low > goal) if word == "at most" else (low >= goal, high < goal)
    outcome = "missed" if missed else "not decided by so few draws"
    return f"{WORDS[word]} {100 * goal:.3g} %: {'met' if met else outcome}"


def _sizes(limit: Mapping[str, Any]) -> str:
    return (
        ", ".join(
            f"{name} {plain(value, 3)}"
            for name, value in limit.items()
            if name not in ("sigma", "draws")
        )
        or "–"
    )
