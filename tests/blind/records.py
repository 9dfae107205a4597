"""The records of several studies, to be scored as one: OUT STUDY … [--note WORDS]."""

import argparse
import json
from dataclasses import dataclass
from pathlib import Path

from tests.blind.counts import Record


@dataclass(frozen=True)
class Studies:
    """Records of several studies.

    out: folder of the scoreboard, made. seeds: of the studies, each once. note: for a reader.
    """

    out: Path
    records: list[Record]
    seeds: list[int]
    note: str


def read_studies() -> Studies:
    """Read the studies that the command line names."""
    parser = argparse.ArgumentParser(description="score the records of several studies as one")
    parser.add_argument("out", type=Path)
    parser.add_argument("studies", type=Path, nargs="+")
    parser.add_argument("--note", default="", help="what a reader should know of them")
    given = parser.parse_args()
    records: list[Record] = []
    seeds: list[int] = []
    for study in given.studies:
        lines = (study / "results.jsonl").read_text("utf-8").splitlines(keepends=True)
        # A study that runs may be at its last one
        records += [json.loads(line) for line in lines if line.endswith("\n")]
        seeds.append(json.loads((study / "study.json").read_text("utf-8"))["seed"])
    given.out.mkdir(parents=True, exist_ok=True)
    return Studies(given.out, records, [*dict.fromkeys(seeds)], given.note)
