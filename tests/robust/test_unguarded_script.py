"""A script of a user that starts processes as it is loaded."""

import subprocess
import sys
from pathlib import Path

SCRIPT = """
from femnl.core.processes import Worker
helper = Worker(print)
helper.process.join()
print(helper.process.exitcode)
"""


def test_processes_that_would_begin_others_as_they_load_a_script_end_in_one_line(
    tmp_path: Path,
) -> None:
    script = tmp_path / "script.py"
    script.write_text(SCRIPT, encoding="utf-8")
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, check=True)
    assert done.stdout == "1\n"
    (line,) = done.stderr.splitlines()
    assert line.endswith('under if __name__ == "__main__":')
