"""Run every benchmark of this folder, each in a process of its own: `python benchmarks/run.py [FOLDER]` (default build/benchmarks)."""

import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).parent


def main() -> int:
    """Run them in the order of their names; the number of those that failed."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else HERE.parent / "build" / "benchmarks"
    folder.mkdir(parents=True, exist_ok=True)
    failed = 0
    for path in sorted(HERE.glob("*.py")):
        if path.name in ("run.py", "__init__.py", "peers_ngsolve.py", "peers_plain.py"):
            continue
        sys.stdout.write(f"== {path.stem}\n")
        sys.stdout.flush()
        command = [sys.executable, "-m", f"{HERE.name}.{path.stem}", str(folder)]
        failed += subprocess.run(command, cwd=HERE.parent, check=False).returncode != 0
    return failed


if __name__ == "__main__":
    sys.exit(main())
