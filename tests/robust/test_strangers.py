"""Files from strangers are data.

Their text is shown, not run, and they lead nowhere outside their folder.
"""

from pathlib import Path

import numpy as np
import pytest

from femnl.cli._main import run
from femnl.io import measurement

EVIL = "<script>alert(1)</script>"


def test_text_of_a_file_is_shown_in_a_report_and_not_run(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    pressure = np.array([0.1, 1, 3, 10, 30, 60, 100, 150, 200, 300.0])
    quality = 2e5 * (1 + 0.01 * np.random.default_rng(4).normal(size=10))
    data = measurement.series(
        {"pressure": pressure}, quality_factor=quality, quality_factor_sd=0.01 * quality
    )
    name = "<img src=x onerror=alert(1)>"
    tree = measurement.bundle({name: data}, geometry="circle", title=EVIL, source=EVIL, sample=EVIL)
    measurement.write(tree, f"{name}.nc")
    assert run(["diagnose", f"{name}.nc", "--out", "page"]) == 0
    page = (tmp_path / "page" / "report.html").read_text(encoding="utf-8")
    assert "<script>alert" not in page
    assert "<img src=x" not in page
    assert "&lt;img src=x onerror=alert(1)&gt;.nc" in page, "the file's name stands there as text"


def test_no_module_of_femnl_runs_what_a_file_says() -> None:
    package = Path(measurement.__file__).parents[1]
    forbidden = (
        "pickle",
        "eval(",
        "exec(",
        "yaml.load",
        "shell=True",
        "os.system",
        "allow_pickle=True",
        "shelve",
        "joblib",
    )
    found = [
        f"{path.relative_to(package)}: {word}"
        for path in package.rglob("*.py")
        for word in forbidden
        if word in path.read_text(encoding="utf-8").replace("model_eval(", "")
    ]
    assert found == []
