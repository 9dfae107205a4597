"""How much of each cause others take up in its place: `python -m tests.blind.imitations FOLDER`.

Files have one cause, by either law, or something that no library has. Each is fitted with every
cause of the library alone. FOLDER/results.jsonl has a line for each file as it is done: what is
done is not done again. At the end what `Effect.imitates` states is printed, to more digits.
"""

import argparse
import json
import sys
import tempfile
import zlib
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from femnl.core.effect import UNKNOWN
from femnl.diagnose.criticism import criticise
from femnl.diagnose.multistart import extended, replaced
from femnl.diagnose.part_of_data import best_in_all
from femnl.diagnose.posing import Posing
from femnl.diagnose.sent import sent
from femnl.effects import library
from femnl.fits.least_squares import FitResult, fit
from femnl.observe.extended import ExtendedModel
from tests.blind.lab import GEOMETRIES
from tests.blind.realistic.files import Draw, make
from tests.blind.realistic.jobs import KINDS, drawn
from tests.blind.realistic.regimes import ALONE

SEED = 20611125
ROUNDS = 4
"""Of files with a cause, which has its first and its second law in turn."""
ALONE_EACH = 5
"""Files of each kind and round with something that no library has."""
LEAST = 1000.0
"""Excess of χ² from which on parts of it are counted: less may be noise."""
MUCH = 0.5
"""Part of another cause from which on it is told."""
LAWS = ("exact", "inexact")


def draws(seed: int, rounds: int, kinds: tuple[str, ...]) -> Iterator[Draw]:
    """Yield the files of a study."""
    for k in range(rounds):
        law = LAWS[k % len(LAWS)]
        for _, draw in drawn(seed + k, 1, kinds, (law,)):
            if draw.causes:
                yield draw
        for kind in kinds:
            for n in range(ALONE_EACH):
                number = zlib.crc32(f"{seed} {k} {kind} {n}".encode())
                films = GEOMETRIES[kind]
                yield Draw(kind, (), ALONE.name, films[number % len(films)], number)


def taken(path: Path) -> tuple[str, dict[str, float]]:
    """Return the kind of a file, and the part of its excess χ² that each cause alone takes up.

    There are no parts where the excess is too small.
    """
    model, effects = Posing(path, None, sent(list(library().values()), 1))(None)
    first = fit(ExtendedModel(model), model.start)
    if first.chi2 - first.degrees < LEAST:
        return model.kind, {}
    pointers = criticise(first, effects).pointers or ()
    begun = {p.effect.name: extended(first, p.effect, list(p.shapes)) for p in pointers}
    begun |= {e.name: replaced(first, e) for e in effects if not e.has_strength}
    fits = {name: best_in_all(found, first) for name, found in begun.items() if found}
    least = min([first.chi2, *(_without(first, one).chi2 for one in fits.values())])
    excess = least - first.degrees
    if excess < LEAST:
        return model.kind, {}
    return model.kind, {name: (least - one.chi2) / excess for name, one in fits.items()}


def _without(first: FitResult, one: FitResult) -> FitResult:
    """Fit the base model from where a cause led.

    A strong misfit may have caught its first fit, and any cause would seem to take up much.
    """
    (start, _) = first.model.split(first.vector)
    (there, _) = one.model.split(one.vector)
    return fit(first.model, first.model.pack(start | there, []), near=first)


def largest(rows: Iterable[dict[str, Any]]) -> dict[str, dict[str, dict[str, float]]]:
    """Return by cause, kind and hidden cause the largest part that the first takes up of the last.

    What is hidden is `UNKNOWN` where no cause is.

    Args: rows: `kind`, `causes` that are hidden, and `taken` of each file.
    """
    found: dict[str, dict[str, dict[str, float]]] = {}
    for row in rows:
        (hidden,) = row["causes"] or (UNKNOWN,)
        for name, part in row["taken"].items():
            if name != hidden:
                parts = found.setdefault(name, {}).setdefault(row["kind"], {})
                parts[hidden] = max(part, parts.get(hidden, 0.0))
    return found


def main() -> None:
    """Run what is missing of the study, and print the largest parts."""
    parser = argparse.ArgumentParser(description="what each cause takes up of others")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--rounds", type=int, default=ROUNDS)
    parser.add_argument("--kinds", default=",".join(KINDS), help="kinds of measurement, by comma")
    given = parser.parse_args()
    given.folder.mkdir(parents=True, exist_ok=True)
    results = given.folder / "results.jsonl"
    results.touch()
    rows = [json.loads(line) for line in results.read_text("utf-8").splitlines()]
    done = {row["name"] for row in rows}
    sys.stderr.write(f"seed {given.seed}\n")
    for draw in draws(given.seed, given.rounds, tuple(given.kinds.split(","))):
        if draw.name in done:
            continue
        with tempfile.TemporaryDirectory() as room:
            path = Path(room) / "file.nc"
            make(draw, path)
            kind, parts = taken(path)
        rows.append({"name": draw.name, "kind": kind, "causes": draw.causes, "taken": parts})
        with results.open("a", encoding="utf-8") as file:
            file.write(json.dumps(rows[-1]) + "\n")
    for name, by_kind in sorted(largest(rows).items()):
        for kind, parts in by_kind.items():
            much = {of: p for of, p in parts.items() if p > MUCH or of == UNKNOWN}
            told = ", ".join(f"{part:.3f} of {of}" for of, part in much.items())
            sys.stdout.write(f"{name}: {kind}: {told or 'little'}\n")


if __name__ == "__main__":
    main()
