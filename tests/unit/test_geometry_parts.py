"""Published kinds of device from a few lengths: areas in closed form, neighbours, and refusals."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from femnl.core.errors import GeometryError
from femnl.device.geometry import curves, load, parse
from femnl.device.mesh import WEDGES, has_symmetry

FILM = """
[film]
thickness = "50 nm"
young = "270 GPa"
poisson = 0.27
density = "3200 kg/m^3"
stress = "1.27 GPa"
"""


def written(**keys: str) -> str:
    rows = "\n".join(f"{key} = {value}" for key, value in keys.items())
    return f'name = "part"\n[outline]\n{rows}\n{FILM}'


def trampoline(**keys: str) -> str:
    usual = {"span": '"500 um"', "tether": '"10 um"', "pad": '"100 um"', "fillet": '"30 um"'}
    return written(kind='"trampoline"', **(usual | keys))


def web(**keys: str) -> str:
    usual = {
        "span": '"800 um"',
        "tethers": "8",
        "tether": '"6 um"',
        "pad": '"60 um"',
        "beams": '["100 um", "200 um"]',
        "beam": '"4 um"',
        "fillet": '"0 um"',
    }
    return written(kind='"web"', **(usual | keys))


def holes(table: str) -> str:
    outline = '[outline]\nkind = "square"\nside = "4 mm"\n'
    return f'name = "part"\n{outline}[holes]\n{table}\n{FILM}'


def test_a_trampoline_has_the_area_of_its_pad_tethers_and_fillets() -> None:
    pad = 100e-6
    tether = 10e-6
    span = 500e-6
    radius = 30e-6
    straight = pad**2 + 4 * tether * (span / 2 - pad / np.sqrt(2) + tether / 4)
    # An arc that turns by 45° leaves R² (tan 22.5° − π/8) of its corner's triangle
    fillets = 8 * radius**2 * (np.tan(np.pi / 8) - np.pi / 8)
    assert curves.area(parse(trampoline(fillet='"0 um"')).outline) == pytest.approx(straight)
    outline = parse(trampoline()).outline
    assert curves.area(outline) == pytest.approx(straight + fillets)
    clamps = [s for s in outline.segments if s.clamped]
    assert len(clamps) == 4
    assert sum(np.hypot(*np.subtract(s.end, s.start)) for s in clamps) == pytest.approx(4 * tether)
    assert has_symmetry(parse(trampoline()), WEDGES["eighth"])


def test_a_web_has_windows_between_its_tethers_and_beams() -> None:
    model = parse(web())
    assert len(model.openings) == 2 * 8
    half = np.pi / 8

    def width(distance: float) -> float:
        return float(2 * distance * np.tan(half) - 6e-6 / np.cos(half))

    middles = np.array([100e-6, 200e-6]) * np.cos(half)
    edges = [30e-6, *np.add.outer(middles, [-2e-6, 2e-6]).ravel()]
    for k, opening in enumerate(model.openings):
        inner, outer = (edges[:2], edges[2:4])[k // 8]
        area = (width(inner) + width(outer)) / 2 * (outer - inner)
        assert curves.area(opening) == pytest.approx(area)
        assert not any(s.clamped for s in opening.segments)
    assert has_symmetry(model, WEDGES["eighth"])
    rounded = parse(web(fillet='"3 um"'))
    assert all(
        curves.area(a) < curves.area(b)
        for a, b in zip(rounded.openings, model.openings, strict=True)
    )


def test_a_dandelion_is_a_web_without_beams() -> None:
    keys = {"kind": '"web"', "span": '"600 um"', "tethers": "12", "tether": '"6 um"'}
    model = parse(written(**keys, pad='"120 um"'))
    assert model.openings == ()
    assert sum(s.clamped for s in model.outline.segments) == 12


def test_holes_of_a_honeycomb_have_three_neighbours_and_leave_a_defect() -> None:
    table = 'lattice = "honeycomb"\npitch = "160 um"\nradius = "40 um"\ncount = [9, 9]\n'
    every = parse(holes(table)).holes.centres
    gaps = np.asarray(cKDTree(every).query(every, k=4)[0])
    inner = np.abs(every).max(axis=1) < 500e-6
    np.testing.assert_allclose(gaps[inner][:, 1:], 160e-6 / np.sqrt(3))
    for mirror in ([-1, 1], [1, -1]):
        assert np.asarray(cKDTree(every).query(every * mirror)[0]).max() < 1e-12
    kept = parse(holes(table + 'defect = "100 um"\n')).holes.centres
    assert len(every) - len(kept) == 6
    assert np.hypot(*kept.T).min() > 100e-6


def test_a_defect_of_a_square_lattice_leaves_its_middle_out() -> None:
    table = 'lattice = "square"\npitch = "100 um"\nradius = "40 um"\ncount = [5, 5]\n'
    kept = parse(holes(table + 'defect = "120 um"\n')).holes.centres
    assert len(kept) == 25 - 5


def test_petals_of_a_ring_point_away_from_its_middle() -> None:
    table = 'lattice = "ring"\ncount = 6\ndistance = "100 um"\nsemi_axes = ["40 um", "10 um"]\n'
    model = parse(holes(table))
    assert len(model.openings) == 6
    for k, opening in enumerate(model.openings):
        ray = np.array([np.cos(k * np.pi / 3), np.sin(k * np.pi / 3)])
        ends = np.array([60e-6 * ray, 140e-6 * ray])
        np.testing.assert_allclose(curves.distance(opening, ends), 0, atol=1e-15)
    assert has_symmetry(model, WEDGES["quarter"])
    across = parse(holes(table + 'angle = "90 deg"\n')).openings[0]
    np.testing.assert_allclose(
        curves.distance(across, np.array([[90e-6, 0.0], [110e-6, 0.0]])), 0, atol=1e-15
    )


def test_slots_of_a_ring_turn_with_it() -> None:
    slot = 'shape = {kind = "rectangle", width = "80 um", height = "20 um", fillet = "10 um"}\n'
    table = 'lattice = "ring"\ncount = 5\ndistance = "100 um"\n' + slot
    model = parse(holes(table))
    assert len(model.openings) == 5
    for k, opening in enumerate(model.openings):
        ray = np.array([np.cos(2 * np.pi * k / 5), np.sin(2 * np.pi * k / 5)])
        ends = np.array([60e-6 * ray, 140e-6 * ray])
        np.testing.assert_allclose(curves.distance(opening, ends), 0, atol=1e-15)
        assert curves.area(opening) == pytest.approx(60e-6 * 20e-6 + np.pi * 10e-6**2)
    assert has_symmetry(model, WEDGES["half"])


@pytest.mark.parametrize(
    "name",
    [
        "dandelion",
        "lotus",
        "soft-clamped-honeycomb",
        "soft-clamped-square",
        "spider-web",
        "trampoline",
    ],
)
def test_shipped_parts_are_solved_by_quarters(name: str) -> None:
    assert has_symmetry(load(name), WEDGES["quarter"])


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (trampoline(pad='"10 um"'), "[outline] pad = 10 um: 4 tethers of 10 um cover it; raise"),
        (trampoline(span='"120 um"'), "[outline] pad = 100 um: it reaches beyond the tethers' "),
        (trampoline(fillet='"300 um"'), "[outline] fillet at point 3 and point 4: the arcs take"),
        (web(beam='"40 um"', beams='["50 um"]'), "[outline] beams = 50 um: it lies on the pad or"),
        (web(beams='["200 um", "100 um"]'), "[outline] beams = 100 um: it lies on the pad or on"),
        (web(beams='["100 um", "399 um"]', beam='"20 um"'), "[outline] beams = 399 um: it reach"),
        (web(beams="[]"), "[outline] beams and beam belong together: the distances of the beams"),
        (web(tethers="2"), "[outline] tethers = 2: expected greater than or equal to 3"),
        (
            trampoline() + '[overhang]\nwidth = "2 um"\n',
            "[overhang] an outline with free edges has no strip of frame all around",
        ),
        (
            holes('lattice = "honeycomb"\npitch = "100 um"\nradius = "30 um"\ncount = [3, 3]'),
            '[holes] pitch = "100 um": holes overlap or touch, the pitch of a honeycomb',
        ),
        (
            web() + '[holes]\nlattice = "list"\ncentres = [["97 um", "0 um"]]\nradius = "3.5 um"\n',
            "[holes] opening 1 at (60.3981, 34.59) um of 72.39 um and the round hole 1 at",
        ),
        (
            holes('lattice = "ring"\ncount = 12\ndistance = "50 um"\nradius = "20 um"'),
            "[holes] hole 1 at (50, 0) um and hole 2 at",
        ),
        (
            holes(
                'lattice = "square"\npitch = "9 um"\nradius = "1 um"\ncount = [3, 3]\ndefect = 4'
            ),
            "[holes] defect = 4: expected a length with its unit",
        ),
    ],
)
def test_parts_that_cannot_be_drawn_are_one_line(words: str, line: str) -> None:
    with pytest.raises(GeometryError) as caught:
        parse(words)
    assert str(caught.value).startswith(f"geometry: {line}")
    assert "\n" not in str(caught.value)
