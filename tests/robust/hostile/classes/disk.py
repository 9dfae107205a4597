"""State on disk that was edited, cut, mixed or locked, and a umask that output has to obey."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from femnl.sweep.point import Point
from femnl.sweep.spec import read_sweep
from tests.robust.hostile.case import Make
from tests.robust.hostile.files import drum, measurement, pick, resonance

SWEEP = """geometry = "drum.toml"
modes = 2
resolution = 0.3
keep = ["frequency", "ratio"]
[[axis]]
film.stress = ["1 GPa", "1.1 GPa", "1.2 GPa"]
"""
ODD: list[Any] = [
    None,
    True,
    -1,
    0,
    1e308,
    -1e308,
    "x",
    "",
    [],
    {},
    [[]],
    [1],
    [None],
    {"a": 1},
    10**30,
    "é\x1b[31m",
]


def odd(rng: np.random.Generator, value: Any) -> Any:
    """Return a value with something in it that does not belong there."""
    if isinstance(value, dict) and value and rng.random() < 0.85:
        name = pick(rng, list(value))
        way = rng.random()
        if way < 0.2:
            return {key: item for key, item in value.items() if key != name}
        return value | {name: odd(rng, value[name])}
    if isinstance(value, list) and value and rng.random() < 0.7:
        way = rng.random()
        if way < 0.3:
            return value[:-1]
        if way < 0.5:
            return [*value, value[-1]]
        at = int(rng.integers(len(value)))
        return [*value[:at], odd(rng, value[at]), *value[at + 1 :]]
    return pick(rng, ODD)


def _record(point: Point, key: str) -> dict[str, Any]:
    results = {
        "label": ["0,1", "1,1"],
        "frequency": [4.2e6, 6.8e6],
        "frequency_error": [1.0, None],
        "ratio": [1.0, 1.593],
        "ratio_error": [0.0, 1e-6],
    }
    return {
        "key": key,
        "varied": point.varied,
        "results": results,
        "seconds": 1.0,
        "memory": 100_000_000,
    }


def _store(rng: np.random.Generator, folder: Path) -> list[str]:
    """Write the store of a sweep, and damage it."""
    drum(folder)
    (folder / "s.toml").write_text(SWEEP, encoding="utf-8")
    sweep = read_sweep(folder / "s.toml")
    settings = {"modes": 2, "resolution": 0.3, "symmetry": "auto", "keep": ["frequency", "ratio"]}
    records: list[Any] = [{"femnl_sweep": 1, "settings": settings, "seed": 5}]
    records += [_record(point, point.key(sweep.settings)) for point in sweep.points(5)]
    lines = []
    for number, record in enumerate(records):
        changed = odd(rng, record) if rng.random() < (0.15 if number == 0 else 0.5) else record
        lines.append(json.dumps(changed).encode())
    path = folder / "s.jsonl"
    path.write_bytes(_damaged(rng, b"\n".join(lines) + b"\n"))
    extra = pick(rng, [[], [], ["--retry"], ["--json"], ["--estimate"]])
    return ["sweep", "s.toml", "--workers", "1", *extra]


def _damaged(rng: np.random.Generator, content: bytes) -> bytes:
    """Damage bytes of a file, now and then."""
    way = int(rng.integers(10))
    at = int(rng.integers(len(content)))
    if way == 0:
        return content[:at]
    if way == 1:
        return content[:at] + rng.bytes(5) + content[at:]
    if way == 2:
        return content[:at] + b"\n" + content[at:]
    if way == 3:
        return content + b'["' + b"[" * 100_000 + b"\n"
    if way == 4:
        return content + b"1" * 6000 + b"\n"
    if way == 5:
        return b"" if rng.random() < 0.5 else b"\n" + content
    return content


def _table(rng: np.random.Generator, folder: Path) -> list[str]:
    """Write a table of diagnoses with its checkpoint, and damage them."""
    frequency, volts = resonance(rng, 60)
    data = {"frequency": frequency[None], "real": volts.real[None], "imag": volts.imag[None]}
    measurement(folder / "f.nc", "response", data, {"noise_sd": 1e-6})
    row = {"file": "f.nc", "verdict": "none", "causes": "", "message": ""}
    line = json.dumps(odd(rng, {"femnl_row": "a" * 32, "sum": "0" * 16, "row": row})).encode()
    for name in ("t.csv", "t.csv.jsonl", "t.jsonl", ".t.csv.jsonl"):
        if rng.random() < 0.6:
            (folder / name).write_bytes(_damaged(rng, line + b"\n"))
    return ["diagnose", "f.nc", "--table", "t.csv", "--workers", "1"]


def _places(rng: np.random.Generator, folder: Path) -> list[str]:
    """Name places for output that are no places for it."""
    frequency, volts = resonance(rng, 60)
    data = {"frequency": frequency[None], "real": volts.real[None], "imag": volts.imag[None]}
    measurement(folder / "f.nc", "response", data, {"noise_sd": 1e-6})
    (folder / "file").write_text("in the way")
    (folder / "folder").mkdir()
    (folder / "dangling").symlink_to("nowhere/at/all")
    (folder / "loop").symlink_to("loop")
    (folder / "o.nc").mkdir()
    place = pick(
        rng,
        [
            "file",
            "folder",
            "file/x",
            "dangling",
            "loop",
            "/dev/null",
            "/dev/full",
            "/proc/x",
            "o.nc",
            "",
            "x" * 300,
            "a/b/c",
            "/dev/stdin",
            ".",
        ],
    )
    return pick(
        rng,
        [
            ["show", "f.nc", "--out", place],
            ["fit", "f.nc", "--out", place],
            ["diagnose", "f.nc", "--out", place, "--workers", "1"],
            ["diagnose", "f.nc", "--table", place, "--workers", "1"],
            ["modes", "circle", "-n", "1", "--resolution", "0.3", "--out", f"{place}.nc"],
            ["modes", "circle", "-n", "1", "--resolution", "0.3", "--out", place],
            ["mesh", "circle", "--resolution", "0.3", "--out", place],
            ["mesh", "circle", "--resolution", "0.3", "--out", f"{place}.vtu"],
            ["maps", "circle", "--z", "1", "--points", "5", "--out", place],
            ["maps", "circle", "--z", "1", "--points", "5", "--out", f"{place}.nc"],
            ["import", "f.nc", place],
            ["fit", "f.nc", "--each-sweep", place],
        ],
    )


def make(rng: np.random.Generator, folder: Path) -> list[str]:
    """Damage state on disk, or name a place that is none."""
    makers: list[Make] = [_store, _store, _table, _places]
    return makers[int(rng.integers(len(makers)))](rng, folder)
