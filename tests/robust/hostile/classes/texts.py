"""Text of files: markup, mathematics, control characters, bytes of no encoding, endless words."""

import os
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from tests.robust.hostile.files import FILM, drum, measurement, pick, resonance

EVIL = [
    "[/b]",
    "[bold]x",
    "[red]",
    "[link=file:///x]y[/link]",
    "$\\foo$",
    "$x^^2$",
    "$" + "{" * 300 + "$",
    "$x_{y$",
    "a$b$c",
    "$$",
    "\\frac",
    "\x1b[2J\x1b[31mred",
    "\x1b]0;title\x07",
    "\x00nul",
    "bell\x07",
    "back\x08\x08",
    "cr\rover",
    "two\nlines",
    "tab\tbed",
    "\u202eright to left",
    "\u2066isolate",
    "\ufffe",
    "zero\u200bwidth",
    "e\u0301" * 40,
    "漢字" * 20,
    "😀" * 10,
    "x" * 300,
    "w" * 100_000,
    "%s %d {0} {x}",
    "<script>alert(1)</script>",
    "&amp;\"'",
    "../../x",
    "a/b",
    "",
    " ",
    "NaN",
]
BYTES = [b"\xff\xfe", b"caf\xe9", b"\x80\x81\x82", b"ok\xed\xa0\x80"]


def word(rng: np.random.Generator) -> str:
    """Return a hostile text, or two of them joined, or random signs."""
    way = rng.random()
    if way < 0.7:
        return str(pick(rng, EVIL))
    if way < 0.85:
        return f"{pick(rng, EVIL)}{pick(rng, EVIL)}"
    signs = rng.integers(1, 0x2FFF, size=int(rng.integers(1, 40)))
    return "".join(chr(int(sign)) for sign in signs)


def stored(rng: np.random.Generator) -> Any:
    """Return a text as HDF5 can store it, bytes of no encoding among them."""
    if rng.random() < 0.2:
        return np.bytes_(pick(rng, BYTES))
    return word(rng).replace("\x00", "\\0")


def _spectrum(rng: np.random.Generator) -> dict[str, Any]:
    labels = [stored(rng) for _ in range(3)]
    kind = h5py.string_dtype()
    texts = [x.decode("utf-8", "surrogateescape") if isinstance(x, bytes) else x for x in labels]
    encoded = [text.encode("utf-8", "surrogateescape") for text in texts]
    return {
        "frequency": np.array([3.4e6, 5.4e6, 7.3e6]),
        "frequency_sd": np.full(3, 10.0),
        "label": np.array(encoded, dtype=kind),
    }


def _of_kind(rng: np.random.Generator, kind: str) -> dict[str, Any]:
    if kind == "spectrum":
        return _spectrum(rng)
    if kind == "response":
        frequency, volts = resonance(rng)
        return {"frequency": frequency[None], "real": volts.real[None], "imag": volts.imag[None]}
    if kind == "series":
        pressure = np.linspace(1, 100, 12)
        return {"pressure": pressure, "quality_factor": 1e5 / (1 + pressure / 30)}
    time = np.linspace(0, 10, 200)
    return {"time": time, "power": -40 - 5 * time + rng.normal(size=200)}


def _group(rng: np.random.Generator) -> str:
    name = word(rng).replace("\x00", "").replace("/", "|")
    return name if name.strip() and name != "." else "g"


def _measured(rng: np.random.Generator, folder: Path) -> list[str]:
    """Put hostile texts everywhere in a measurement file."""
    kind = pick(rng, ["spectrum", "response", "series", "decay"])
    places = ("title", "source", "sample", "history", "model", "geometry", "note")
    root = {name: stored(rng) for name in places if rng.random() < 0.25}
    if rng.random() < 0.6:
        root = {**root, "geometry": drum(folder)}
        root.pop("model", None)
    given = {name: stored(rng) for name in ("mode", "notes", "sample", "odd") if rng.random() < 0.4}
    if rng.random() < 0.1:
        given["wavelength"] = stored(rng)
    path = folder / "f.nc"
    group = _group(rng) if rng.random() < 0.6 else "data"
    measurement(path, kind, _of_kind(rng, kind), given, root, group)
    with h5py.File(path, "a") as file:
        node = file[group]
        if rng.random() < 0.2:
            node[_group(rng)] = [1.0]
        if rng.random() < 0.2:
            name = next(iter(node))
            node[name].attrs["units"] = stored(rng)
        if rng.random() < 0.1:
            node.attrs["kind"] = stored(rng)
        if rng.random() < 0.1:
            file.attrs["femnl_measurement"] = stored(rng)
    name = _renamed(rng, path)
    command = pick(rng, ["show", "show", "fit", "fit", "diagnose"])
    out = {
        "show": [["--out", "o"]],
        "fit": [["--out", "o"], ["--json"], []],
        "diagnose": [["--workers", "1"], ["--workers", "1", "--json"]],
    }[command]
    return [command, name, *pick(rng, out)]


def _renamed(rng: np.random.Generator, path: Path) -> str:
    """Give a file a hostile name, now and then."""
    if rng.random() > 0.3:
        return path.name
    stem = word(rng).replace("\x00", "").replace("/", "|")[:50].strip(".") or "f"
    name = f"{stem}{path.suffix}"
    if rng.random() < 0.3:
        name = os.fsdecode(pick(rng, BYTES)) + path.suffix
    while len(os.fsencode(name)) > 200:
        name = name[len(name) // 2 :]
    try:
        path.rename(path.with_name(name))
    except OSError:
        return path.name
    return f"./{name}"


def _table(rng: np.random.Generator, folder: Path) -> list[str]:
    """Put hostile texts into a text table and the TOML beside it."""
    heads = [word(rng).replace("\x00", "") for _ in range(3)]
    rows = [[f"{1e6 + k}", "1", "2"] for k in range(20)]
    if rng.random() < 0.4:
        rows[int(rng.integers(20))][int(rng.integers(3))] = word(rng)
    text = "\n".join(",".join(row) for row in [heads, *rows])
    content = text.encode("utf-8", "surrogatepass")
    if rng.random() < 0.2:
        content = content.replace(b"1", pick(rng, BYTES), 1)
    (folder / "t.csv").write_bytes(content)
    wanted = heads if rng.random() < 0.5 else [word(rng) for _ in range(3)]
    keys = ("frequency", "real", "imag")
    quoted = [f"{key} = {in_quotes(value)}" for key, value in zip(keys, wanted, strict=True)]
    extra = f"title = {in_quotes(word(rng))}\n" if rng.random() < 0.5 else ""
    spec = f'kind = "response"\n{extra}[columns]\n' + "\n".join(quoted) + "\n"
    (folder / "t.toml").write_text(spec, encoding="utf-8")
    name = _renamed(rng, folder / "t.csv")
    return pick(rng, [["import", name, "o.nc", "--spec", "t.toml"], ["fit", name, "--out", "o"]])


def in_quotes(text: str) -> str:
    """Return a text as TOML writes it."""
    signs = (f"\\U{ord(sign):08x}" if sign in '"\\' or ord(sign) < 32 else sign for sign in text)
    return '"' + "".join(signs).replace("\x7f", "\\U0000007f") + '"'


def _device(rng: np.random.Generator, folder: Path) -> list[str]:
    """Put hostile texts into a geometry, a sweep or a study."""
    keys = ('"drum"', '"circle"', '"100 um"', '"250 GPa"', "thickness")
    text = FILM.replace(str(pick(rng, list(keys))), in_quotes(word(rng)))
    if rng.random() < 0.3:
        text += f"source = {in_quotes(word(rng))}\n"
    drum(folder, text)
    if rng.random() < 0.4:
        axis = (
            f'geometry = "drum.toml"\n[[axis]]\n{in_quotes(word(rng))} = [{in_quotes(word(rng))}]\n'
        )
        (folder / "s.toml").write_text(axis, encoding="utf-8")
        return ["sweep", "s.toml", "--workers", "1", "--estimate"]
    if rng.random() < 0.3:
        study = f"name = {in_quotes(word(rng))}\n[[device]]\nname = {in_quotes(word(rng))}\n"
        study += f"[[device.modes]]\nfrequency = {in_quotes(word(rng))}\n"
        (folder / "c.toml").write_text(study, encoding="utf-8")
        return ["chip", "c.toml"]
    name = _renamed(rng, folder / "drum.toml")
    return [pick(rng, ["mesh", "modes", "bands"]), name, "--resolution", "0.3"]


def _words(rng: np.random.Generator, folder: Path) -> list[str]:
    """Put hostile texts into the words of a command."""
    text = word(rng).replace("\x00", "") or "x"
    if rng.random() < 0.2:
        text = os.fsdecode(pick(rng, BYTES))
    return pick(
        rng,
        [
            ["modes", text],
            ["show", text],
            ["effects", text],
            ["fit", text],
            [text],
            ["validate", text],
            ["view", "circle", text],
            ["modes", "circle", "--edge", text],
            ["modes", "circle", "--bow", text],
            ["maps", "circle", "--z", "1", "--wavelength", text],
            ["mesh", "circle", "--symmetry", text],
            ["import", text, "o.nc"],
            ["sweep", text],
            ["chip", text],
            ["geometries", "--format", text],
        ],
    )


def make(rng: np.random.Generator, folder: Path) -> list[str]:
    """Put hostile texts somewhere."""
    way = rng.random()
    if way < 0.5:
        return _measured(rng, folder)
    if way < 0.7:
        return _table(rng, folder)
    if way < 0.85:
        return _device(rng, folder)
    return _words(rng, folder)
