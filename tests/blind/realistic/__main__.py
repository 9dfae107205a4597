"""`python -m tests.blind.realistic FOLDER --seed S --rounds N`, from the top of the repository.

Every file is one line of FOLDER/results.jsonl as it is done: what is done is not done again. The
scoreboard is written at the end; `python -m tests.blind.realistic.score` writes it any time.
"""

import argparse
import json
import os
import sys
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from tests.blind.realistic.jobs import KINDS, about, drawn, run
from tests.blind.realistic.regimes import REGIMES
from tests.blind.realistic.score import score, write

LIMIT = 600.0
"""Seconds of a processor after which a file counts as without an answer."""


def known(folder: Path, seed: int | None) -> tuple[int, list[dict[str, Any]]]:
    """Return the seed of a study and what is done of it; a torn last line is cut off."""
    folder.mkdir(parents=True, exist_ok=True)
    note = folder / "study.json"
    if note.is_file():
        old = int(json.loads(note.read_text(encoding="utf-8"))["seed"])
        if seed not in (None, old):
            raise SystemExit(f"{folder} holds the study of seed {old}; give another folder")
        seed = old
    elif seed is None:
        seed = int(np.random.SeedSequence().generate_state(1)[0])
    note.write_text(json.dumps({"seed": seed}), encoding="utf-8")
    results = folder / "results.jsonl"
    lines = results.read_bytes().splitlines(keepends=True) if results.is_file() else []
    whole = [line for line in lines if line.endswith(b"\n")]
    results.write_bytes(b"".join(whole))
    return seed, [json.loads(line) for line in whole]


def main() -> None:
    """Run what is missing of the study."""
    parser = argparse.ArgumentParser(description="the realistic regime of the blind study")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seed", type=int, help="of a new study; fresh unless given")
    parser.add_argument("--rounds", type=int, default=1, help="of about 80 files each")
    parser.add_argument("--kinds", default=",".join(KINDS), help="kinds of measurement, by comma")
    parser.add_argument("--regimes", default=",".join(REGIMES), help="regimes, by comma")
    parser.add_argument("--limit", type=float, default=LIMIT, help="seconds of a processor a file")
    given = parser.parse_args()
    seed, records = known(given.folder, given.seed)
    done = {one["name"] for one in records}
    draws = drawn(
        seed, given.rounds, tuple(given.kinds.split(",")), tuple(given.regimes.split(","))
    )
    todo = [(k, draw) for k, draw in draws if draw.name not in done]
    sys.stderr.write(f"seed {seed}; {len(todo)} of {len(draws)} files to go\n")
    results = given.folder / "results.jsonl"
    with results.open("a", encoding="utf-8") as file, ProcessPoolExecutor(1) as pool:
        for count, (k, draw) in enumerate(todo, 1):
            future = pool.submit(run, k, draw, given.limit)
            # A file that fails is told, and does not end the study
            error = future.exception()
            found = about(k, draw) | {"verdict": "error", "seconds": 0.0, "error": repr(error)}
            if error is None:
                found = future.result()
            line = json.dumps(found)
            file.write(line + "\n")
            file.flush()
            os.fsync(file.fileno())
            # As it is read again, so that a score does not depend on when it is made
            records.append(json.loads(line))
            answer = found.get("verdict", found.get("error"))
            sys.stderr.write(f"{count}/{len(todo)} {draw.name}: {answer} {found.get('named')}\n")
    write(score(records, {"seeds": [seed], "note": ""}), given.folder)
    sys.stdout.write((given.folder / "table.md").read_text(encoding="utf-8"))


if __name__ == "__main__":
    main()
