"""A fringe that bends by what the film moves at each place of the readout."""

from pathlib import Path

import numpy as np
import pytest

from femnl import load
from femnl.fits.response.first_fit import of_weak_sweeps
from femnl.fits.response.fit import fit_response
from femnl.fits.response.pose import pose
from femnl.observe.film import SimulatedFilm
from tests.physics.driven_sweeps import F0, PHASES, WAVELENGTH, Bench, Complex, lock_in

SIDE = 270e-6
PLACES = ((60e-6, 60e-6), (110e-6, 70e-6))


def seen(bench: Bench, place: tuple[float, float], theta: float) -> Complex:
    """Return sweeps that a cosine fringe sees at a place on a film of sines."""
    shape = np.prod([np.sin(2 * np.pi * (part / SIDE + 0.5)) for part in place])
    amplitude = bench.amplitude()
    motion = shape * np.abs(amplitude)[..., None] * np.cos(PHASES)
    first = lock_in(np.cos(4 * np.pi / WAVELENGTH * motion + theta))
    return np.asarray(0.02 * first * amplitude / np.abs(amplitude) * np.exp(0.4j))


@pytest.mark.slow
def test_two_places_see_one_motion_through_fringes_that_bend_as_they_move(
    tmp_path: Path,
) -> None:
    bench = Bench()
    volts = np.concatenate([seen(bench, place, 1.2) for place in PLACES])
    x, y = np.repeat(np.array(PLACES), len(bench.drives), axis=0).T
    found = bench.diagnose(
        tmp_path / "a.nc",
        volts,
        drive=np.tile(bench.drives, 2),
        direction=np.tile(bench.direction, 2),
        x=x,
        y=y,
    )
    assert (found.verdict, found.causes) == ("explained", ("nonlinear_readout",)), (
        found.where,
        found.alternatives,
    )
    # The metres of the test rest on the simulated α, which is good to 1 %.
    assert found.parameters["nonlinear_readout"]["share"].value == pytest.approx(1, abs=0.03)


@pytest.mark.slow
def test_one_place_that_is_not_recorded_gives_the_square_of_the_shape_there(
    tmp_path: Path,
) -> None:
    bench = Bench()
    found = bench.diagnose(tmp_path / "a.nc", seen(bench, PLACES[1], 1.2))
    assert (found.verdict, found.causes) == ("explained", ("nonlinear_readout",))
    square = np.prod([np.sin(2 * np.pi * (part / SIDE + 0.5)) for part in PLACES[1]]) ** 2
    share = found.parameters["nonlinear_readout"]["share"]
    assert share.value == pytest.approx(square, abs=4 * share.sd)


FOLDED = Bench(width=420.0, stretch=18.0, points=101)
"""Motion of 0.5 µm, over which the first harmonic of the fringe changes its sign three times."""


@pytest.mark.slow
def test_the_weakest_drive_tells_that_a_film_stiffens_whatever_strong_ones_show() -> None:
    data = FOLDED.measured(seen(FOLDED, PLACES[0], 1.2))
    # In the place of fits to all drives, which end on either side far from the data
    softer, stiffer = (
        fit_response(data, background="none", delay=True, phase_sign=1, fixed={"alpha_ratio": a})
        for a in (-20.0, 20.0)
    )
    found = of_weak_sweeps(data, softer, "alpha_y", 1)
    assert found is not None
    assert abs(found["frequency"] - F0) < FOLDED.width / 4
    assert found["linewidth"] == pytest.approx(FOLDED.width, rel=0.2)
    assert found["alpha_y"] > 0
    assert of_weak_sweeps(data, stiffer, "alpha_y", 1) is None
    one = data.isel(sweep=data["drive"].values > 0.3)
    assert of_weak_sweeps(one, softer, "alpha_y", 1) is None


@pytest.mark.slow
def test_a_mode_that_is_linear_at_the_weakest_drive_tells_no_sign() -> None:
    weak = FOLDED.drives == FOLDED.drives.min()
    straight = FOLDED.peak * 0.05 / (1 + 2j * (FOLDED.frequency - F0) / FOLDED.width)
    volts = seen(FOLDED, PLACES[0], 1.2)
    volts[weak] = 1e-3 * straight / np.abs(straight).max()
    data = FOLDED.measured(volts)
    softer = fit_response(
        data, background="none", delay=True, phase_sign=1, fixed={"alpha_ratio": -20.0}
    )
    assert of_weak_sweeps(data, softer, "alpha_y", 1) is None


@pytest.mark.slow
def test_sweeps_over_several_fringes_do_not_make_the_film_soften() -> None:
    """At strong drives the mode looks as if it softened, and no fit leads to the other sign."""
    data = FOLDED.measured(seen(FOLDED, PLACES[0], 1.2))
    posed = pose(data, SimulatedFilm(load("square-270um"), 12))
    assert not posed.softens
    assert len(posed.equivalent_solutions({})) == 1
    frequency, width, peak, *_ = posed.start
    assert abs(frequency - F0) < FOLDED.width / 4
    assert (width, peak) == pytest.approx((FOLDED.width, FOLDED.peak), rel=0.3)


@pytest.mark.slow
def test_a_fringe_is_named_whatever_it_makes_of_strong_motion(tmp_path: Path) -> None:
    found = FOLDED.diagnose(tmp_path / "a.nc", seen(FOLDED, PLACES[0], 1.2))
    assert (found.verdict, found.causes) == ("explained", ("nonlinear_readout",))
