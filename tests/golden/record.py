"""The golden record: what femnl says of fixed inputs, kept while the code is rebuilt.

`python -m tests.golden.record write` runs every job and writes `tests/golden/record.json.xz`.
`python -m tests.golden.record compare` runs them again and lists every difference; --only TEXT
picks jobs whose name contains TEXT. Verdicts and names must be equal, numbers equal within --rtol
or, where a standard deviation stands beside a value, within --sigma of it. Sentences may change.
"""

import argparse
import contextlib
import io
import json
import lzma
import math
import os
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

RECORD = Path(__file__).parent / "record.json.xz"
SEED = 20261123
"""Of the round of blind files."""
SENTENCES = (
    "where",
    "seconds",
    "measure_next",
    "file",
    "sha256",
    "says",
    "claim",
    "source",
    "remark",
)
"""Keys whose text may be written anew."""


def job_names() -> list[str]:
    """Return the name of every job: `diagnose …`, `fit …`, `modes …` and `validate`."""
    from tests.blind.jobs import jobs
    from tests.golden.fits import FITS

    names = [f"diagnose {job.name}" for job in jobs(SEED, 1)]
    names += [f"fit {name}" for name in FITS]
    geometries = Path(__file__).parents[2] / "geometries"
    names += [f"modes {path.stem}" for path in sorted(geometries.glob("*.toml"))]
    return [*names, "validate"]


def run_job(name: str) -> tuple[str, Any]:
    """Run one job in a folder of its own and return its name and what it printed or returned."""
    task, _, rest = name.partition(" ")
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        if task == "diagnose":
            return name, _diagnosed(rest, Path(folder))
        if task == "fit":
            from tests.golden.fits import FITS

            make, words = FITS[rest]
            make("data.nc")
            return name, _printed(["fit", "data.nc", *words, "--json"])["fits"]
        if task == "modes":
            return name, _printed(["modes", rest, "--json", "--no-cache"])
        return name, _printed(["validate", "--format", "json"])


def _diagnosed(name: str, folder: Path) -> dict[str, Any]:
    from femnl.diagnose import diagnose, record
    from femnl.effects import library
    from tests.blind.jobs import jobs
    from tests.blind.lab import make

    (job,) = [job for job in jobs(SEED, 1) if job.name == name]
    gone = set(job.case.causes) if job.task == "removed" else set()
    make(job.case, folder / "file.nc")
    found = diagnose(
        folder / "file.nc", effects=[e for e in library().values() if e.name not in gone]
    )
    plain: dict[str, Any] = json.loads(json.dumps(record(found), default=list))
    return plain


def _printed(words: list[str]) -> Any:
    from femnl.cli._main import run

    printed = io.StringIO()
    with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(io.StringIO()):
        status = run(words)
    text = printed.getvalue()
    return json.loads(text) if text.lstrip()[:1] in ("{", "[") else {"status": status, "text": text}


def run_all(names: list[str], workers: int) -> dict[str, Any]:
    """Run jobs side by side, saying each as it ends; an error becomes its text."""
    found: dict[str, Any] = {}
    os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1"))
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        futures = {name: pool.submit(run_job, name) for name in names}
        for count, (name, future) in enumerate(futures.items(), 1):
            error = future.exception()
            found[name] = {"error": repr(error)} if error else future.result()[1]
            sys.stderr.write(f"{count}/{len(names)} {name} {found[name].get('error', '')}\n")
    return found


def differences(
    old: Any, new: Any, rtol: float, sigma: float, at: str = "", scale: float = 0.0
) -> Iterator[str]:
    """List where two JSON values differ; `scale` is the standard deviation beside a number."""
    if isinstance(old, dict) and isinstance(new, dict):
        for key in sorted(old.keys() | new.keys()):
            if key in SENTENCES:
                continue
            if key not in old or key not in new:
                yield f"{at}/{key}: only in the {'old' if key in old else 'new'} record"
                continue
            beside = [
                float(old.get(name) or 0.0)
                for name in ("sd", f"{key}_sd")
                if _is_number(old.get(name))
            ]
            yield from differences(
                old[key], new[key], rtol, sigma, f"{at}/{key}", max(beside, default=0.0)
            )
    elif isinstance(old, list) and isinstance(new, list):
        if len(old) != len(new):
            yield f"{at}: {len(old)} items, now {len(new)}"
        for place, (before, after) in enumerate(zip(old, new, strict=False)):
            yield from differences(before, after, rtol, sigma, f"{at}[{place}]")
    elif _is_number(old) and _is_number(new):
        both_nan = math.isnan(old) and math.isnan(new)
        if not both_nan and not abs(old - new) <= max(rtol * abs(old), sigma * scale, 1e-300):
            yield f"{at}: {old!r} → {new!r} ({abs(old - new) / (abs(old) or 1.0):.1e})"
    elif old != new:
        yield f"{at}: {old!r} → {new!r}"


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def main() -> int:
    """Write the record, or compare with it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("task", choices=("write", "compare"))
    parser.add_argument("--only", default="", help="jobs whose name contains this")
    parser.add_argument("--every", type=int, default=1, help="every n-th of them")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--rtol", type=float, default=1e-9)
    parser.add_argument("--sigma", type=float, default=0.0)
    given = parser.parse_args()
    names = [name for name in job_names() if given.only in name][:: given.every]
    found = run_all(names, given.workers)
    if given.task == "write":
        with lzma.open(RECORD, "wt", encoding="utf-8") as file:
            json.dump({"seed": SEED, "jobs": found}, file)
        return 0
    with lzma.open(RECORD, "rt", encoding="utf-8") as file:
        kept = json.load(file)["jobs"]
    lines = [
        f"{name} {line}"
        for name in names
        for line in differences(kept[name], found[name], given.rtol, given.sigma)
    ]
    sys.stdout.write("".join(f"{line}\n" for line in lines))
    worse = len(
        {
            name
            for name in names
            if any(differences(kept[name], found[name], given.rtol, given.sigma))
        }
    )
    sys.stdout.write(f"{len(names) - worse} of {len(names)} jobs agree\n")
    return 1 if lines else 0


if __name__ == "__main__":
    sys.exit(main())
