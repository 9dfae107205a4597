"""The picture of the architecture is that of the code."""

import importlib.util
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "docs"


def test_the_picture_of_the_architecture_is_up_to_date() -> None:
    spec = importlib.util.spec_from_file_location("architecture", DOCS / "architecture.py")
    assert spec is not None
    assert spec.loader is not None
    architecture = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(architecture)
    drawn = (DOCS / "architecture.svg").read_text(encoding="utf-8")
    assert drawn == architecture.draw(), "run `python docs/architecture.py`"
    with pytest.raises(LookupError, match="has no function fly"):
        architecture.returned("pipeline.py", "fly")
