"""Layouts that were drawn by mistake, damaged, or made to blow up when they are read."""

from pathlib import Path
from typing import Any

import gdstk
import numpy as np

from tests.robust.hostile.classes.texts import word
from tests.robust.hostile.files import FILM, drum, pick

LAYERS = [
    "film=1/0",
    "film=1/0,holes=2/0",
    "film=1/0,metal=4/0",
    "film=1/0,release=3/0,holes=2/0,posts=5/0,metal=4/0",
    "film=1/0,frame=3/0",
    "film=9/9",
    "holes=2/0",
    "film=1/0,film=2/0",
    "film",
    "film=",
    "film=a/b",
    "film=1/0/0",
    "film=-1/0",
    "film=99999999999/0",
    "metal=1/0,film=1/0",
    "",
]


def _shapes(rng: np.random.Generator) -> list[Any]:
    """Return polygons of a film and what lies on it, sound ones and others."""
    size = float(pick(rng, [50, 50, 50, 50, 50, 1e-4, 1e5]))
    turn = float(pick(rng, [0, 0, np.pi / 4, 1e-9]))
    film = [
        gdstk.rectangle((-size, -size), (size, size)),
        gdstk.ellipse((0, 0), size, tolerance=1e-3 * size),
        gdstk.Polygon([(-size, -size), (size, size), (size, -size), (-size, size)]),
        gdstk.Polygon([(0, 0), (size, 0), (size, 0), (0, 1e-9)]),
        gdstk.Polygon(_star(rng, int(pick(rng, [7, 300, 3_000])), size)),
    ][int(rng.choice(5, p=[0.4, 0.3, 0.1, 0.05, 0.15]))].rotate(turn)
    film.layer = 1
    found = [film]
    for layer in (2, 3, 4, 5):
        for _ in range(int(pick(rng, [0, 0, 0, 1, 3, 40]))):
            centre = rng.uniform(-size, size, 2) * pick(rng, [0.5, 0.5, 1.0, 3.0])
            radius = size * float(pick(rng, [0.02, 0.02, 0.1, 2.0, 1e-7]))
            shape = gdstk.ellipse(tuple(centre), radius, tolerance=1e-2 * radius, layer=layer)
            found.append(shape)
    return found


def _star(rng: np.random.Generator, corners: int, size: float) -> Any:
    angle = 2 * np.pi * np.arange(corners) / corners
    radius = size * rng.uniform(0.3, 1.0, corners)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)


def _library(rng: np.random.Generator, path: Path) -> None:
    unit = float(pick(rng, [1e-6, 1e-6, 1e-6, 1e-9, 1e-12, 1.0]))
    library = gdstk.Library(unit=unit, precision=unit * 1e-3)
    cell = library.new_cell("TOP")
    cell.add(*_shapes(rng))
    if rng.random() < 0.15:  # arrays of arrays, which become 10^6 or 10^12 polygons
        inner = cell
        for level in range(int(pick(rng, [2, 4]))):
            outer = library.new_cell(f"L{level}")
            outer.add(gdstk.Reference(inner, columns=1_000, rows=1, spacing=(1, 1)))
            inner = outer
    if rng.random() < 0.1:
        library.new_cell("OTHER").add(*_shapes(rng))
    if path.suffix == ".gds":
        library.write_gds(path, max_points=0)
    else:
        library.write_oas(path)


def _svg(rng: np.random.Generator, path: Path) -> None:
    points = " ".join(f"{x:.3f},{y:.3f}" for x, y in _star(rng, 8, 50))
    body = pick(
        rng,
        [
            f'<polygon points="{points}"/>',
            '<path d="M0 0 L10 0 L10 10 Z"/>',
            '<path d="M0 0 C 1e400 0 nan 1 x y Z"/>',
            '<circle cx="0" cy="0" r="-5"/>',
            '<use href="#film"/>',
            f'<rect width="{"9" * 400}" height="1"/>',
            "<g>" * 3_000 + "</g>" * 3_000,
            "",
        ],
    )
    head = pick(rng, ["", '<!DOCTYPE s [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;">]>'])
    size = pick(rng, ['width="100um" height="100um" viewBox="0 0 100 100"', "", 'width="0"'])
    opening = f'<svg xmlns="http://www.w3.org/2000/svg" {size}>'
    text = f'{head}{opening}<g id="film">{body}</g></svg>'
    path.write_text(text, encoding="utf-8")


def _drawn(rng: np.random.Generator, folder: Path) -> str:
    """Write a layout, damaged now and then, and return its name."""
    path = folder / str(pick(rng, ["l.gds", "l.gds", "l.gds", "l.oas", "l.svg", "l.dxf"]))
    if path.suffix == ".svg":
        _svg(rng, path)
    elif path.suffix == ".dxf":
        path.write_text(str(pick(rng, ["0\nSECTION\n", "", "0\nEOF\n", "x\n" * 9])), "utf-8")
    else:
        _library(rng, path)
    content = path.read_bytes()
    way = int(rng.integers(8))
    at = int(rng.integers(len(content) + 1))
    if way == 0:
        path.write_bytes(content[:at])
    elif way == 1:
        path.write_bytes(content[:at] + rng.bytes(6) + content[at + 6 :])
    return path.name


def _layers(rng: np.random.Generator) -> list[str]:
    if rng.random() < 0.1:
        return ["--layers", word(rng).replace("\0", "")[:2_000]]
    chosen = pick(rng, LAYERS[:5]) if rng.random() < 0.85 else pick(rng, LAYERS)
    return ["--layers", str(chosen)]


def _export(rng: np.random.Generator, folder: Path) -> list[str]:
    """Export a device with layers to some place."""
    circle = 'shape = {kind = "circle", diameter = "40 um"}\n'
    layer = '[[layers]]\nname = "metal"\nthickness = "30 nm"\nyoung = "70 GPa"\npoisson = 0.34\n'
    layer += 'density = "2700 kg/m^3"\nstress = "50 MPa"\n'
    text = FILM.replace("[readout]", f"{layer}{pick(rng, ['', circle])}[readout]")
    drum(folder, text)
    dest = pick(rng, ["o.gds", "o.oas", "o.dxf", "o.toml", "o", "none/o.gds", "drum.toml", "."])
    return ["geometry", "export", str(pick(rng, ["drum.toml", "trampoline", "none"])), str(dest)]


def make(rng: np.random.Generator, folder: Path) -> list[str]:
    """Draw a layout, and ask a command for it."""
    if rng.random() < 0.1:
        return _export(rng, folder)
    name = _drawn(rng, folder)
    extra = pick(rng, [[], [], [], [], ["--cell", "TOP"], ["--cell", "NONE"], ["--unit", "um"]])
    like = pick(rng, [[], [], [], ["--like", "metallised-drum"], ["--like", "none"]])
    if rng.random() < 0.5:
        dest = str(pick(rng, ["o.toml"] * 8 + ["o.gds", "none/o.toml"]))
        return ["geometry", "import", name, dest, *_layers(rng), *extra, *like]
    out = ["--out", str(pick(rng, ["o.png"] * 8 + ["o.xyz", "none/o.png"]))]
    return ["geometry", "check", name, *_layers(rng), *extra, *like, *out]
