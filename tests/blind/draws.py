"""A study that draws cases by seeds, one result a line, and goes on where it stopped."""

import argparse
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from tests.blind.counts import Record


def study(
    description: str,
    judge: Callable[[int], Record],
    score: Callable[[list[Record]], dict[str, Any]],
    draws: int,
) -> None:
    """Draw the cases that are missing, judge them, and write the scoreboard.

    Args: description: of the command. judge: says of a seed what was found. score: the rates of all
        results. draws: how many cases by default.
    """
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--draws", type=int, default=draws)
    given = parser.parse_args()
    sys.stderr.write(f"seed {given.seed}\n")
    given.folder.mkdir(parents=True, exist_ok=True)
    results = given.folder / f"results-{given.seed}.jsonl"
    lines = results.read_text(encoding="utf-8").splitlines() if results.is_file() else []
    records: list[Record] = [json.loads(line) for line in lines]
    seeds = np.random.default_rng(given.seed).integers(0, 2**32, given.draws)
    with results.open("a", encoding="utf-8") as file:
        for seed in seeds[len(records) :]:
            line = json.dumps(judge(int(seed)))
            file.write(line + "\n")
            file.flush()
            # As it is read again, so that a score does not depend on when it is made
            records.append(json.loads(line))
    board = {
        "seeds": [given.seed],
        "draws": len(records),
        "note": "",
        "rates": score(records),
        "limits": {},
    }
    (given.folder / "scoreboard.json").write_text(
        json.dumps(board, indent=1, ensure_ascii=False), encoding="utf-8"
    )
