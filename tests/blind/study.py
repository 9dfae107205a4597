"""The blind study: `python -m tests.blind.study FOLDER`, from the top of the repository.

Every draw is one line of FOLDER/results.jsonl, written as it finishes, so that a run that is killed
loses only what was under way and the next one goes on from there. With --scheduler the draws go to
the workers of a Dask cluster, started in the same directory.
"""

import argparse
import json
import os
import sys
from collections.abc import Iterator
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

import numpy as np

from tests.blind.jobs import Job, jobs, run
from tests.blind.lab import KINDS
from tests.blind.scoreboard import draw, score

ROUNDS = 10
"""Rounds of the full study: a hundred nulls of each kind."""


def plan(
    folder: Path, rounds: int, seed: int | None, kinds: tuple[str, ...]
) -> tuple[int, list[Job], Path]:
    """Return the seed, the draws still to be made, and the file of results.

    A torn last line of that file is cut off.
    """
    folder.mkdir(parents=True, exist_ok=True)
    note = folder / "study.json"
    results = folder / "results.jsonl"
    if note.is_file():
        seed = int(json.loads(note.read_text(encoding="utf-8"))["seed"])
    elif seed is None:
        seed = int(np.random.SeedSequence().generate_state(1)[0])
    note.write_text(json.dumps({"seed": seed}), encoding="utf-8")
    lines = results.read_bytes().splitlines(keepends=True) if results.is_file() else []
    whole = [line for line in lines if line.endswith(b"\n")]
    results.write_bytes(b"".join(whole))
    done = {json.loads(line)["name"] for line in whole}
    return seed, [job for job in jobs(seed, rounds, kinds) if job.name not in done], results


def finished(
    todo: list[Job], scheduler: str | None, workers: int
) -> Iterator[tuple[Job, dict[str, Any]]]:
    """Run the draws, on this machine or a cluster, and return each as it ends.

    One that failed with its error.
    """
    if scheduler:
        from distributed import Client
        from distributed import as_completed as completed

        with Client(scheduler) as client:
            remote = {client.submit(_on_worker, job, pure=False): job for job in todo}
            for future in completed(list(remote)):
                yield remote[future], _outcome(remote[future], future)
        return
    with ProcessPoolExecutor(workers) as pool:
        local = {pool.submit(run, job): job for job in todo}
        for done in as_completed(local):
            yield local[done], _outcome(local[done], done)


def _on_worker(job: Job) -> dict[str, Any]:
    """Run a draw.

    Its file belongs to this worker alone, so xarray needs no lock of a cluster.
    """
    import dask

    with dask.config.set(scheduler="synchronous"):
        return run(job)


def _outcome(job: Job, future: Future[dict[str, Any]]) -> dict[str, Any]:
    error = future.exception()
    if error is None:
        return future.result()
    about = {
        "name": job.name,
        "task": job.task,
        "file": job.file,
        "kind": job.case.kind,
        "geometry": job.case.geometry,
    }
    return about | {
        "causes": sorted(job.case.causes),
        "seed": job.case.seed,
        "round": job.round,
        "error": repr(error),
    }


def main() -> None:
    """Run what is missing of the study and write its scoreboard."""
    parser = argparse.ArgumentParser(
        description="hide causes in measurement files, diagnose them, and keep the score"
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument(
        "--draws",
        type=int,
        default=ROUNDS,
        help="rounds; each hides every cause of every kind once",
    )
    parser.add_argument("--seed", type=int, help="of a new study; fresh unless given")
    parser.add_argument("--scheduler", help="address of a Dask scheduler")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--kinds", default=",".join(KINDS), help="kinds of measurement, by comma")
    given = parser.parse_args()
    seed, todo, results = plan(given.folder, given.draws, given.seed, tuple(given.kinds.split(",")))
    sys.stderr.write(f"seed {seed}; {len(todo)} draws to go\n")
    with results.open("a", encoding="utf-8") as file:
        for count, (job, record) in enumerate(finished(todo, given.scheduler, given.workers), 1):
            file.write(json.dumps(record) + "\n")
            file.flush()
            os.fsync(file.fileno())
            sys.stderr.write(
                f"{count}/{len(todo)} {job.name}: {record.get('verdict', record.get('error'))} "
                f"{record.get('named', '')}\n"
            )
    records = [json.loads(line) for line in results.read_text(encoding="utf-8").splitlines()]
    board = score(records, [seed])
    (given.folder / "scoreboard.json").write_text(
        json.dumps(board, indent=1, ensure_ascii=False), encoding="utf-8"
    )
    draw(board, records, given.folder)
    sys.stdout.write(json.dumps(board, indent=1, ensure_ascii=False) + "\n")


if __name__ == "__main__":
    main()
