"""Draw hostile cases of every class, and count what each came to.

`python -m tests.robust.hostile.study FOLDER CASES SEED [CLASS…]` runs CASES of each class, the
first of seed SEED, and writes FOLDER/cases.jsonl and the table FOLDER/table.md.
"""

import json
import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules

from tests.robust.hostile import classes
from tests.robust.hostile.case import Make, Result, run_case

FAULTS = (
    "traceback",
    "hang",
    "memory",
    "lines",
    "long",
    "control",
    "status",
    "umask",
    "net",
    "slow",
)
PRELOADED = (
    "femnl.cli._main",
    "femnl.cli.show",
    "femnl.cli.fit",
    "femnl.cli.diagnose",
    "femnl.diagnose",
    "femnl.report.diagnosis",
    "femnl.plot.measurement",
    "femnl.sweep.runner",
    "femnl.sweep.tables",
    "femnl.pipeline",
    "femnl.io.labfiles",
    "femnl.io.measurement.files",
    "femnl.io.measurement.sizes",
    "matplotlib.backends.backend_agg",
)
"""Modules that are loaded once, in the process that cases are forks of."""


def makers() -> dict[str, Make]:
    """Return the classes of cases by name: `make` of each module in `classes`."""
    names = [found.name for found in iter_modules(classes.__path__)]
    return {name: import_module(f"{classes.__name__}.{name}").make for name in names}


def preload() -> None:
    """Load what most cases need, so that a case takes milliseconds and not seconds to start."""
    for name in PRELOADED:
        import_module(name)


def table(results: Sequence[Result]) -> str:
    """Return the counts of faults by class, as Markdown."""
    kinds = sorted({result.kind for result in results})
    rows = ["| class | cases | " + " | ".join(FAULTS) + " | slowest (s) | most memory (MiB) |"]
    rows.append("|---|" + "---:|" * (len(FAULTS) + 3))
    for kind in [*kinds, "all"]:
        own = [result for result in results if kind in (result.kind, "all")]
        counts = Counter(fault.split()[0] for result in own for fault in result.faults)
        cells = [str(len(own)), *(str(counts[fault]) for fault in FAULTS)]
        cells.append(f"{max(result.seconds for result in own):.0f}")
        cells.append(f"{max(result.mebibytes for result in own):.0f}")
        rows.append(f"| {kind} | {' | '.join(cells)} |")
    return "\n".join(rows) + "\n"


def main(folder: Path, cases: int, first: int, wanted: Sequence[str]) -> int:
    """Run the cases; 1 where one has a fault."""
    folder.mkdir(parents=True, exist_ok=True)
    preload()
    found = makers()
    results = []
    with (folder / "cases.jsonl").open("w", encoding="utf-8") as file:
        for kind in wanted or sorted(found):
            for seed in range(first, first + cases):
                result = run_case(kind, seed, found[kind], folder / "cache")
                results.append(result)
                file.write(json.dumps(asdict(result)) + "\n")
                file.flush()
    text = table(results)
    (folder / "table.md").write_text(text, encoding="utf-8")
    sys.stdout.write(text)
    return int(any(result.faults for result in results))


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]), sys.argv[4:]))
