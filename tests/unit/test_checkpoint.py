"""Checkpoints of diagnoses: what a kill or an edit leaves of them."""

import logging
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from femnl.core.checkpoint import Found, open_checkpoint


def fits(path: Path) -> list[str]:
    """Keep three fits, and return the lines of the file."""
    kept = open_checkpoint(path)
    for number in range(3):
        kept.recall(f"fit {number}", partial(found, number))
    return path.read_text(encoding="utf-8").splitlines(keepends=True)


def found(number: int) -> Found:
    return np.array([float(number), 0.1]), np.array([1e-3])


def made_anew(path: Path) -> list[int]:
    """Return which of the three fits are not recalled."""
    again = []
    kept = open_checkpoint(path)

    def make(number: int) -> Found:
        again.append(number)
        return found(number)

    for number in range(3):
        vector, _ = kept.recall(f"fit {number}", partial(make, number))
        assert vector[0] == number
    return again


def test_a_torn_last_line_is_cut_off_in_silence(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "fits.jsonl"
    lines = fits(path)
    path.write_text("".join(lines)[:-9], encoding="utf-8")
    with caplog.at_level(logging.WARNING):
        assert made_anew(path) == [2]
    assert not caplog.records
    assert [*tmp_path.iterdir()] == [path]
    assert made_anew(path) == []


def test_an_edited_line_is_told_set_aside_and_made_anew(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "fits.jsonl"
    lines = fits(path)
    lines[1] = lines[1].replace("0.1", "0.2")
    path.write_text("".join(lines), encoding="utf-8")
    with caplog.at_level(logging.WARNING):
        assert made_anew(path) == [1]
    assert "1 of 3 lines are damaged, the first of them line 2" in caplog.text
    aside = tmp_path / "fits.jsonl.damaged"
    assert aside.read_text(encoding="utf-8") == "".join(lines)
    assert made_anew(path) == []
