"""Labels of modes of a round film: nodal diameters and nodal circles, by Bessel's zeros."""

from pathlib import Path

import numpy as np
import pytest
from scipy.special import jn_zeros

from femnl import load
from femnl.core.errors import MeasurementError
from femnl.diagnose import diagnose
from femnl.fits.spectrum.labels import named_modes
from femnl.fits.spectrum.round_labels import UNKNOWN_TURN, is_round, round_orders
from femnl.io import measurement
from femnl.observe.film import SimulatedFilm

COUNT = 30
DRUM = """
name = "drum"
assumed = ["film"]

[outline]
kind = "circle"
diameter = "65 cm"

[film]
thickness = "0.2 mm"
young = "4 GPa"
poisson = 0.38
density = "1390 kg/m^3"
stress = "20 MPa"
"""


@pytest.fixture(scope="module")
def film() -> SimulatedFilm:
    """A round film."""
    return SimulatedFilm(load("circle"), COUNT)


def ideal_orders(count: int) -> list[tuple[int, int]]:
    """Orders (m, n) of the lowest modes of an ideal round film, by rising j_mn, pairs twice."""
    zeros = [(z, m, n + 1) for m in range(20) for n, z in enumerate(jn_zeros(m, 10))]
    found: list[tuple[int, int]] = []
    for _, m, n in sorted(zeros):
        found += [(m, n)] * (2 if m else 1)
    return found[:count]


@pytest.mark.slow
def test_modes_of_a_round_film_have_the_orders_of_bessel_s_zeros(film: SimulatedFilm) -> None:
    assert list(round_orders(film)) == ideal_orders(COUNT)


def test_a_label_that_comes_twice_names_both_modes_of_a_pair(film: SimulatedFilm) -> None:
    found = named_modes(("0,1", "(2,1)", "2,1", "0,2"), film)
    assert found.order.tolist() == [0, 3, 4, 5]
    assert np.array_equal(found.target, np.eye(film.count)[found.order])


def test_a_label_that_comes_once_names_no_turn_of_the_pair(film: SimulatedFilm) -> None:
    found = named_modes(("2,1",), film)
    assert found.order.tolist() == [3]
    assert found.target[0, [3, 4]] == pytest.approx([np.cos(UNKNOWN_TURN), np.sin(UNKNOWN_TURN)])
    # Split along the axes or along the diagonals, one of the two is the nearer one
    for turn in (0.0, np.pi / 4):
        pair = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
        share = np.sort((pair @ found.target[0, [3, 4]]) ** 2)
        assert share[1] > 0.8


@pytest.mark.parametrize(
    ("label", "message"),
    [
        (("1,1", "1,1", "(1,1)"), "comes more often than the modes that it names, 2"),
        (("0,1", "0,1"), "comes more often than the modes that it names, 1"),
        (("1,0",), "the edge among them, as 0,1 for the lowest mode"),
        (("9,9",), f"none of the first {COUNT} modes of circle"),
        (("(1,3)+(3,1)",), "is no mode of a round film"),
    ],
)
def test_labels_that_name_no_mode_are_refused(
    film: SimulatedFilm, label: tuple[str, ...], message: str
) -> None:
    with pytest.raises(MeasurementError, match=r"spectrum/label: ") as refusal:
        named_modes(label, film)
    assert message in str(refusal.value)


def test_only_circles_are_round() -> None:
    assert is_round(load("circle").outline)
    assert not is_round(load("square-270um").outline)
    assert not is_round(load("hexagon-278um").outline)


@pytest.mark.slow
def test_modes_without_the_lowest_one_are_those_of_an_ideal_drum(tmp_path: Path) -> None:
    named = [(1, 1), (2, 1), (0, 2), (3, 1), (1, 2)]
    frequency = np.array([jn_zeros(m, n)[-1] for m, n in named]) * 40.0
    spectrum = measurement.spectrum(
        frequency, 1e-4 * frequency, label=[f"{m},{n}" for m, n in named]
    )
    path = tmp_path / "drum.nc"
    measurement.write(measurement.bundle({"spectrum": spectrum}, model=DRUM), path)
    found = diagnose(path)
    assert found.verdict == "adequate"
    # f = j c/2πR; the film may bend, within what the data allow
    speed = found.parameters["base"]["speed"]
    assert speed.value == pytest.approx(40.0 * 2 * np.pi * 0.325, rel=1e-3)
