"""TOML of strangers is bounded before tomllib reads it."""

import time
import tomllib
from typing import Any

import pytest

from femnl.core.resources import geometries
from femnl.core.toml import DEEPEST, parse_toml

LONG = {
    "dotted": ".".join("a" * 100_000) + " = 1",
    "table": "[" + ".".join("a" * 100_000) + "]",
    "quoted": " . ".join(['"a.b"'] * 100_000) + " = 1",
    "literal": ".".join(["'a.b'"] * 100_000) + " = 1",
    "within braces": "x = {" + ".".join("a" * 100_000) + " = 1}",
    "after others": "x = 1\n" + ".".join(["b\u0065"] * 40) + " = 1",
}


@pytest.mark.parametrize("name", LONG)
def test_a_key_of_many_parts_is_refused_before_it_fills_the_memory(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def never(text: str) -> Any:
        raise AssertionError(f"{len(text)} characters were read")

    monkeypatch.setattr(tomllib, "loads", never)
    with pytest.raises(ValueError, match="brackets or keys nested too deep"):
        parse_toml(LONG[name])


@pytest.mark.parametrize(
    "text",
    [
        'x = "' + "a" * 10**6 + '"',
        "x = '" + '"' * 10**6 + "'",
        'x = "' + '\\"' * 10**6 + '"',
        "x = [" + '"a", ' * 10**5 + "]",
        "# " + "a." * (DEEPEST - 1) + "\n",
        ".".join("a" * (DEEPEST - 1)) + " = 1",
    ],
)
def test_what_is_no_long_key_is_read_in_seconds(text: str) -> None:
    began = time.process_time()
    parse_toml(text)
    assert time.process_time() - began < 5


def test_the_shipped_geometries_are_read_as_tomllib_does() -> None:
    for path in geometries().glob("*.toml"):
        text = path.read_text(encoding="utf-8")
        assert parse_toml(text) == tomllib.loads(text)
