"""A file with glitches in which nothing is hidden: the whole way from file to verdict."""

from pathlib import Path

from femnl.diagnose import diagnose
from tests.blind.realistic.files import Draw, make


def test_sweeps_with_glitches_alone_are_adequate_and_the_glitches_are_listed(
    tmp_path: Path,
) -> None:
    truth = make(Draw("response", (), "glitches", "square-270um", 11), tmp_path / "file.nc")
    found = diagnose(tmp_path / "file.nc", effects=[])
    assert found.verdict == "adequate", found.where
    strong = [size for size in truth["glitches"] if size > 10]
    assert len(strong) <= len(found.excluded) <= len(truth["glitches"]) + 1
    assert found.excluded[0].where.startswith("sweep ")
