"""The file of several scoreboards keeps its version and the studies that are not replaced."""

import json
from pathlib import Path

import pytest

from tests.blind import boards


def keep(out: Path, **studies: Path) -> None:
    """Run the command."""
    boards.main([str(out), *(f"{name}={folder}" for name, folder in studies.items())])


def study(folder: Path, draws: int) -> Path:
    """Write a scoreboard into a folder."""
    folder.mkdir()
    (folder / "scoreboard.json").write_text(json.dumps({"draws": draws}), encoding="utf-8")
    return folder


def test_a_study_replaces_its_own_scoreboard_alone(tmp_path: Path) -> None:
    out = tmp_path / "blind.json"
    keep(out, weak=study(tmp_path / "a", 1), realistic=study(tmp_path / "b", 2))
    keep(out, weak=study(tmp_path / "c", 3))
    assert json.loads(out.read_text(encoding="utf-8")) == {
        "femnl_blind": "1.1",
        "weak": {"draws": 3},
        "realistic": {"draws": 2},
    }


@pytest.mark.parametrize("old", ['{"femnl_blind": "1.0"}', '{"seeds": [1]}'])
def test_a_file_of_another_version_is_refused_and_stays(
    old: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "blind.json"
    out.write_text(old, encoding="utf-8")
    folder = study(tmp_path / "a", 1)
    with pytest.raises(SystemExit):
        keep(out, weak=folder)
    assert "is not of version 1.1" in capsys.readouterr().err
    assert out.read_text(encoding="utf-8") == old
