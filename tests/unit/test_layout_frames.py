"""Frames that touch a film: which of its edges they hold, after export and import."""

from pathlib import Path

import gdstk
import numpy as np
import pytest

from femnl import load
from femnl.core.device import Model
from femnl.core.errors import GeometryError
from femnl.core.resources import find_geometry
from femnl.device.geometry import curves
from femnl.device.layout import import_layout
from femnl.device.layout.export import export_layout

LIKE = load(find_geometry("square-270um"))
CIRCLE = 'shape = { kind = "circle", diameter = "100 um" }'
OVAL = 'shape = { kind = "ellipse", width = "120 um", height = "70 um" }'
CUT = '[[outline.parts]]\nname = "cut"\noperation = "subtract"\n{shape}\n{more}\n'
NOTCH = 'shape = { kind = "rectangle", width = "40 um", height = "10 um" }'
HALF = 'shape = { kind = "square", side = "100 um" }'
SHAPES = {
    "half disc": (CIRCLE, HALF, 'at = ["50 um", "0 um"]', 100e-6),
    "notched disc": (CIRCLE, NOTCH, 'at = ["50 um", "0 um"]', None),
    "notched ellipse": (OVAL, NOTCH, 'at = ["60 um", "0 um"]', None),
    "turned notch": (CIRCLE, NOTCH, 'at = ["40 um", "24 um"]\nangle = "31 deg"', None),
}


def device(path: Path, whole: str, cut: str, more: str) -> Model:
    """Write and load a device with a part cut out, whose edges are free."""
    parts = f"[[outline.parts]]\n{whole}\n" + CUT.format(shape=cut, more=more)
    outline = f'[outline]\nkind = "combined"\nfree = ["cut"]\n{parts}'
    text = find_geometry("square-270um").read_text(encoding="utf-8")
    square = '[outline]\nkind = "square"\nside = "270 um"\n'
    assert square in text
    path.write_text(text.replace(square, outline), encoding="utf-8")
    return load(path)


def lengths(model: Model) -> tuple[float, float]:
    """Return how much of the edge is clamped, and how much free [m]."""
    found = {True: 0.0, False: 0.0}
    for segment in model.outline.segments:
        along = curves.point_at(segment, np.linspace(0, 1, 2001))
        found[segment.clamped] += float(np.hypot(*np.diff(along, axis=0).T).sum())
    return found[True], found[False]


@pytest.mark.parametrize("name", SHAPES)
def test_free_edges_survive_export_and_import(tmp_path: Path, name: str) -> None:
    whole, cut, more, free = SHAPES[name]
    model = device(tmp_path / "a.toml", whole, cut, more)
    export_layout(model, tmp_path / "a.gds")
    layers = {"film": "1/0", "frame": "3/0"}
    again = import_layout(tmp_path / "a.gds", layers, LIKE).model
    assert lengths(again) == pytest.approx(lengths(model), rel=1e-5)
    assert curves.area(again.outline) == pytest.approx(curves.area(model.outline), rel=1e-5)
    if free is not None:
        assert lengths(again)[1] == pytest.approx(free, rel=1e-6)


def test_a_frame_drawn_by_hand_may_touch_the_film(tmp_path: Path) -> None:
    disc = gdstk.ellipse((0, 0), 50, tolerance=1e-3, layer=1)
    film = gdstk.boolean(disc, gdstk.rectangle((30, -5), (60, 5)), "not", layer=1)
    block = gdstk.rectangle((-80, -80), (30, 80))
    frame = gdstk.boolean(block, film, "not", layer=3)
    path = tmp_path / "a.gds"
    library = gdstk.Library()
    library.new_cell("A").add(*film, *frame)
    library.write_gds(path)
    found = import_layout(path, {"film": "1/0", "frame": "3/0"}, LIKE).model
    held = 2 * (np.pi - np.arccos(0.6)) * 50e-6  # the arc left of x = 30 µm
    clamped, free = lengths(found)
    assert clamped == pytest.approx(held, rel=1e-4)
    right = 2 * (np.arccos(0.6) - np.arcsin(0.1)) * 50e-6
    assert free == pytest.approx(
        right + 2 * (50e-6 * np.cos(np.arcsin(0.1)) - 30e-6) + 10e-6, rel=1e-4
    )


def test_a_frame_that_overlaps_the_film_is_cut_off(tmp_path: Path) -> None:
    path = tmp_path / "a.gds"
    library = gdstk.Library()
    film = gdstk.rectangle((-50, -50), (50, 50), layer=1)
    library.new_cell("A").add(film, gdstk.rectangle((-80, -80), (-40, 80), layer=3))
    library.write_gds(path)
    found = import_layout(path, {"film": "1/0", "frame": "3/0"}, LIKE).model
    assert curves.area(found.outline) == pytest.approx(9e-9)
    assert lengths(found) == pytest.approx((100e-6, 280e-6))


def test_a_frame_all_around_holds_the_whole_edge(tmp_path: Path) -> None:
    film = gdstk.Polygon([(-50, -40), (50, -50), (60, 40), (0, 20), (-50, 50)], layer=1)
    frame = gdstk.boolean(gdstk.rectangle((-80, -80), (80, 80)), film, "not", layer=3)
    path = tmp_path / "a.gds"
    library = gdstk.Library()
    library.new_cell("A").add(film, *frame)
    library.write_gds(path)
    found = import_layout(path, {"film": "1/0", "frame": "3/0"}, LIKE).model
    assert len(found.outline.segments) == 5
    assert lengths(found)[1] == 0


def layout(path: Path, film: list[gdstk.Polygon], frame: list[gdstk.Polygon]) -> Model:
    """Import a film and the frame that holds it."""
    library = gdstk.Library()
    cell = library.new_cell("A")
    cell.add(*(gdstk.Polygon(one.points, layer=1) for one in film))
    cell.add(*(gdstk.Polygon(one.points, layer=3) for one in frame))
    library.write_gds(path)
    return import_layout(path, {"film": "1/0", "frame": "3/0"}, LIKE).model


@pytest.mark.parametrize("overlap", [0.2, 1.0])
def test_a_pad_that_overlaps_a_long_string_a_little_holds_it(
    tmp_path: Path, overlap: float
) -> None:
    string = gdstk.rectangle((-1000, -2), (1000, 2))
    pads = [
        gdstk.rectangle((-1050, -20), (-1000, 20)),
        gdstk.rectangle((1000 - overlap, -20), (1050, 20)),
    ]
    found = layout(tmp_path / "a.gds", [string], pads)
    assert lengths(found) == pytest.approx((8e-6, 2 * (2000 - overlap) * 1e-6))


def test_a_pillar_on_the_layer_of_the_frame_is_refused(tmp_path: Path) -> None:
    hole = gdstk.rectangle((-10, -10), (10, 10))
    film = gdstk.boolean(gdstk.rectangle((-50, -50), (50, 50)), hole, "not")
    with pytest.raises(GeometryError, match="on the layer of holes, or of posts"):
        layout(tmp_path / "a.gds", film, [hole])


def test_pads_of_a_turned_film_hold_the_edges_that_they_touch(tmp_path: Path) -> None:
    """Corners are rounded to 1 nm, so that a pad's edge is off the film's by a step of the grid."""
    rng = np.random.default_rng(8)
    for angle in rng.uniform(0, np.pi, 30):
        film, *pads = (
            gdstk.rectangle(*corners).rotate(angle)
            for corners in (
                ((-50, -50), (50, 50)),
                ((-90, -70), (-50, 70)),
                ((50, -33.5), (90, 33.5)),
            )
        )
        for one in (film, *pads):
            one.points[:] = np.round(one.points, 3)
        path = tmp_path / f"{angle:.4f}.gds"
        assert lengths(layout(path, [film], pads))[0] == pytest.approx(167e-6, abs=0.02e-6)
