"""Figures of the blind study, drawn from its scoreboard.

Which cause is taken for which, and how large it must be.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from femnl.plot.style import COLOURS, INK, new_figure, style

DETECTABLE = 5.0
"""σ by which each cause must stand out to be counted on."""
FOUND = 0.95
"""Share of draws in which the limit of detection is found."""


SHARE_NEAR = 0.1
"""How far a share may be from the true one."""


def confusion_figure(confusion: Mapping[str, Any]) -> Figure:
    """Draw how often each hidden cause (a row) got each answer (a column).

    Colours are shares of the row.
    """
    hidden = confusion["hidden"]
    answers = confusion["answers"]
    table = np.array(confusion["draws"])
    share = table / np.maximum(table.sum(axis=1, keepdims=True), 1)
    with style():
        figure = new_figure(height=0.2 * len(hidden) + 1.7)
        axes = figure.add_subplot()
        axes.imshow(share, cmap="Blues", vmin=0, vmax=1, aspect="auto")
        for (i, j), n in np.ndenumerate(table):
            if n:
                axes.text(
                    j,
                    i,
                    str(n),
                    ha="center",
                    va="center",
                    fontsize=7 if n < 100 else 5,
                    color="white" if share[i, j] > 0.6 else INK,
                )
        axes.set_xticks(
            range(len(answers)), [_words(name) for name in answers], rotation=90, fontsize=7.5
        )
        axes.set_yticks(range(len(hidden)), [_words(name) for name in hidden], fontsize=7.5)
        axes.set_xticks(np.arange(len(answers)) - 0.5, minor=True)
        axes.set_yticks(np.arange(len(hidden)) - 0.5, minor=True)
        axes.grid(which="minor", color="#dddddd", linewidth=0.4)
        axes.tick_params(which="minor", length=0)
        axes.set_xlabel("answer of the diagnosis")
        axes.set_ylabel("hidden cause")
    return figure


def detection_figure(detection: Mapping[str, Any], limits: Mapping[str, Any]) -> Figure:
    """Draw for each cause and kind the sizes at which it was named and was not."""
    with style():
        figure = new_figure(height=0.17 * len(detection) + 1.0)
        axes = figure.add_subplot()
        for y, (name, draws) in enumerate(detection.items()):
            for key, colour, mark in (("named", COLOURS[0], "|"), ("missed", COLOURS[1], "x")):
                axes.plot(draws[key], np.full(len(draws[key]), y), mark, color=colour, markersize=5)
            if name in limits:
                axes.plot([limits[name]["sigma"]], [y], "k^", markersize=5)
        axes.plot([], [], "|", color=COLOURS[0], label="named")
        axes.plot([], [], "x", color=COLOURS[1], label="not named")
        axes.plot([], [], "k^", label=f"named in {FOUND:.0%}")
        axes.axvline(DETECTABLE, color="#999999", linewidth=0.7)
        axes.set_xscale("log")
        axes.set_yticks(range(len(detection)), [_words(name) for name in detection], fontsize=7.5)
        axes.set_ylim(len(detection) - 0.4, -0.6)
        axes.set_xlabel("size of the effect in the data, in σ")
        figure.legend(loc="outside upper center", ncols=3)
    return figure


def shares_figure(shares: Sequence[Mapping[str, Any]]) -> Figure:
    """Draw the share told of each cause, less the true one, against the size of the cause.

    shares: of each cause its size `sigma` [σ], its share `true` and `told`, and the `sd` of that,
    which is the bar.
    """
    with style():
        figure = new_figure(width=5.0, height=3.0)
        axes = figure.add_subplot()
        axes.axhspan(-SHARE_NEAR, SHARE_NEAR, color="#eeeeee", linewidth=0)
        axes.axhline(0, color="#999999", linewidth=0.7)
        axes.errorbar(
            [s["sigma"] for s in shares],
            [s["told"] - s["true"] for s in shares],
            yerr=[s["sd"] for s in shares],
            fmt="o",
            markersize=3,
            linewidth=0.7,
            color=COLOURS[0],
        )
        axes.set_xscale("log")
        axes.set_ylim(-1.1, 1.1)
        axes.set_xlabel("size of the effect in the data, in σ")
        axes.set_ylabel("share told, less the true one")
    return figure


def _words(name: str) -> str:
    return name.replace("_", " ")
