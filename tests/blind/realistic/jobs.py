"""The draws of the realistic study, round by round, and what is kept of each."""

import signal
import tempfile
import time
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np

from femnl.diagnose import diagnose, record
from femnl.effects import library
from tests.blind.jobs import IMPOSSIBLE, pulls_of
from tests.blind.lab import GEOMETRIES, Case, causes
from tests.blind.realistic.files import Draw, make
from tests.blind.realistic.regimes import QUIET, REGIMES, allowed

KINDS = ("spectrum", "holes", "response", "map", "series", "trace", "record", "decay")
"""Kinds of one measurement; files of several are in the older study alone."""
NULLS = 2
"""Files in which nothing is hidden, in every round, for each kind."""


class TooLongError(Exception):
    """A file took longer than a study allows."""


def drawn(
    seed: int,
    rounds: int,
    kinds: tuple[str, ...] = KINDS,
    regimes: tuple[str, ...] = tuple(REGIMES),
) -> list[tuple[int, Draw]]:
    """Return every file with its round, in an order that makes a part of a round a fair one.

    In each round every cause of every kind is in one file, whose regime goes through all of them in
    as many rounds.
    """
    found = []
    for k in range(rounds):
        own = [(k, draw) for kind in kinds for draw in _round(seed, k, kind, regimes)]
        order = np.random.default_rng([seed, k]).permutation(len(own))
        found += [own[i] for i in order]
    return found


def _round(seed: int, k: int, kind: str, regimes: tuple[str, ...]) -> Iterator[Draw]:
    possible = [regime for regime in REGIMES if regime in regimes and allowed(regime, kind)]
    quiet = [regime for regime in QUIET if regime in possible]
    for i, cause in enumerate(causes(kind)):
        if possible and _films(kind, (cause,)):
            yield _draw(seed, k, kind, (cause,), possible[(k + i) % len(possible)])
    for n in range(min(NULLS, len(quiet))):
        yield _draw(seed, k, kind, (), quiet[(NULLS * k + n) % len(quiet)])


def _films(kind: str, hidden: tuple[str, ...]) -> list[str]:
    """Return the devices on which the laboratory can hide these causes."""
    return [
        geometry
        for geometry in GEOMETRIES[kind]
        if all((cause, geometry) not in IMPOSSIBLE for cause in hidden)
    ]


def _draw(seed: int, k: int, kind: str, hidden: tuple[str, ...], regime: str) -> Draw:
    drawn = zlib.crc32(f"{seed} {k} {kind} {hidden} {regime}".encode())
    films = _films(kind, hidden)
    return Draw(kind, hidden, regime, films[drawn % len(films)], drawn)


def about(k: int, draw: Draw) -> dict[str, Any]:
    """Return what is known of a file before it is made, and no answer."""
    return {
        "name": draw.name,
        "round": k,
        "kind": draw.kind,
        "geometry": draw.geometry,
        "regime": draw.regime,
        "causes": sorted(draw.causes),
        "seed": draw.seed,
        "sigma": {},
        "shares": {},
        "glitches": [],
        "named": [],
        "alternatives": [],
    }


def run(k: int, draw: Draw, limit: float) -> dict[str, Any]:
    """Make the file of a draw, diagnose it, and return what the scoreboard needs.

    A file without an answer after `limit` seconds of a processor has the verdict "none in time".
    """
    known_of = about(k, draw)
    gone = set(draw.causes) if REGIMES[draw.regime].lacking else set()
    known = [effect for effect in library().values() if effect.name not in gone]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "file.nc"
        truth = make(draw, path)
        known_of |= {key: truth[key] for key in ("options", "sigma", "shares", "glitches")} | {
            "truth": truth["causes"]
        }
        start = time.process_time()
        try:
            with within(limit):
                found = diagnose(path, effects=known)
                answer = record(found)
                equals = []
                if gone and found.causes:
                    equals = told(record(diagnose(path)))
        except TooLongError:
            return known_of | {"verdict": "none in time", "seconds": limit, "named": []}
        seconds = time.process_time() - start
    pulls = {}
    if sorted(found.causes) == sorted(draw.causes):
        case = Case(draw.kind, draw.causes, draw.seed, draw.geometry)
        exact = truth["options"]["deviation"] == 0
        pulls = pulls_of(case, truth, found.parameters, exact)
    return known_of | {
        "verdict": answer["verdict"],
        "named": sorted(answer["causes"]),
        "alternatives": told(answer),
        "found_shares": answer.get("shares", {}),
        "excluded": answer.get("excluded", []),
        "remainder": answer.get("remainder"),
        "noise": answer.get("noise"),
        "p_value": found.p_value,
        "before": found.before.chi2_reduced,
        "after": found.after.chi2_reduced,
        "best": [
            [list(trial.causes), trial.chi2, trial.p_value]
            for trial in sorted(found.trials, key=lambda trial: trial.chi2)[:5]
        ],
        "own": [
            [trial.chi2, trial.p_value]
            for trial in found.trials
            if sorted(trial.causes) == sorted(draw.causes)
        ],
        "equals": equals,
        "pulls": pulls,
        "seconds": seconds,
    }


AGAIN = 1.0
"""Seconds after which a file that goes on is stopped again."""
TOLD = 1e-3
"""Probability from which on an alternative counts as told."""


def told(answer: dict[str, Any]) -> list[list[str]]:
    """Return the sets of causes that a diagnosis tells, the one that it names first."""
    others = [
        sorted(other["causes"]) for other in answer["alternatives"] if other["probability"] > TOLD
    ]
    named = sorted(answer["causes"])
    return [named, *(names for names in others if names != named)]


@contextmanager
def within(seconds: float) -> Iterator[None]:
    """Raise `TooLongError` where what is inside takes longer, in seconds of a processor."""

    def stop(number: int, frame: FrameType | None) -> None:
        raise TooLongError

    before = signal.signal(signal.SIGPROF, stop)
    # Again and again: one that comes inside a finaliser is swallowed there
    signal.setitimer(signal.ITIMER_PROF, seconds, AGAIN)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)
