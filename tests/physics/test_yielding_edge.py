"""An edge that yields in the plane of the film, against polynomials, a ledge, and itself anew."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import eigh

from femnl.core.device import Clamp
from femnl.core.stages import ModalSystem
from femnl.core.tension import YIELDS_MOST
from femnl.device.geometry import parse
from femnl.diagnose import diagnose
from femnl.effects import library
from femnl.observe.film import SimulatedFilm
from femnl.pipeline import solve_modes
from tests.blind.lab import Case, inplane, make
from tests.physics.changed_films import relative_shift, system_of
from tests.physics.test_tension_gradient import CIRCLE, POISSON, SQUARE

Array = NDArray[np.float64]
COUNT = 24
SIDE = 100e-6


@cache
def film() -> SimulatedFilm:
    return SimulatedFilm(parse(SQUARE), COUNT)


def on_edge(plain: ModalSystem, compliance: float) -> ModalSystem:
    found = library()["yielding_edge"].changes["operators"](plain, {"compliance": compliance})
    assert isinstance(found, ModalSystem)
    return found


def beyond_first(shift: Array) -> Array:
    """What the speed of waves does not take up."""
    return np.asarray((1 + shift[1:]) / (1 + shift[0]) - 1)


@pytest.mark.parametrize("compliance", [0.2e-6, 1.5e-6, 5e-6])
def test_ratios_are_those_of_polynomials_over_the_whole_film(compliance: float) -> None:
    sides = (SIDE, SIDE)
    square, _ = inplane.yielded_modes(sides, sides, POISSON, compliance, (3, 3))
    plain = np.pi / SIDE * np.sqrt([m * m + n * n for m in range(1, 6) for n in range(1, 6)])
    exact = np.sqrt(np.sort(square)[:11]) / np.sort(plain)[:11] - 1
    found = relative_shift(on_edge(system_of(film()), compliance), system_of(film()))[:11]
    assert beyond_first(found) == pytest.approx(beyond_first(exact), abs=5e-7)
    assert np.abs(beyond_first(exact)).max() > 5e-5
    assert found[0] == pytest.approx(exact[0], abs=8e-6)


def test_ratios_between_the_solved_compliances_are_those_of_the_film_solved_anew() -> None:
    model = film().model
    compliance = 0.7 * YIELDS_MOST * SIDE / 2
    across = model.film.young * model.film.thickness / compliance
    clamp = Clamp(normal=across, shear=across * (1 - POISSON) / 2)
    anew = solve_modes(replace(model, clamp=clamp), 12, cache=False).frequency
    found = on_edge(system_of(film()), compliance)
    own = np.sqrt(eigh(found.stiffness, found.mass, eigvals_only=True)[:12]) / (2 * np.pi)
    assert own[1:] / own[0] == pytest.approx(anew[1:] / anew[0], rel=2e-7)


def test_a_disc_slackens_evenly_as_lame_says() -> None:
    # S/σ = 1/(1 + (λ/R)/(1 − ν)), so that only the speed of waves changes.
    disc = SimulatedFilm(parse(CIRCLE), 8)
    compliance = 0.15 * SIDE / 2
    shift = relative_shift(on_edge(system_of(disc), compliance), system_of(disc))
    assert shift == pytest.approx(np.full(8, (1 + 0.15 / (1 - POISSON)) ** -0.5 - 1), abs=5e-6)
    assert beyond_first(shift) == pytest.approx(0, abs=1e-7)


def test_ratios_stay_those_of_a_rigid_square_where_nothing_yields() -> None:
    plain = system_of(film())
    assert relative_shift(on_edge(plain, 0.0), plain) == pytest.approx(0, abs=1e-14)


RIVALS = ("tension_gradient", "added_mass", "compliant_clamp", "bending_stiffness")


@pytest.mark.parametrize(
    ("case", "least"),
    [
        # λ = 1.3 µm and errors of 3 Hz; λ = 1.8 µm and errors of 100 Hz
        (Case("spectrum", ("yielding_edge",), 3), (90, 150, 100, 200)),
        pytest.param(
            Case("spectrum", ("yielding_edge",), 2, "rectangle"),
            (70, 30, 10, 75),
            marks=pytest.mark.slow,
        ),
    ],
    ids=["square", "rectangle"],
)
@pytest.mark.slow
def test_an_edge_that_yields_is_told_from_all_that_it_resembles(
    case: Case, least: tuple[float, ...], tmp_path: Path
) -> None:
    truth = make(case, tmp_path / "a.nc")["causes"]["yielding_edge"]["compliance"]
    found = diagnose(tmp_path / "a.nc")
    assert (found.verdict, found.causes) == ("explained", ("yielding_edge",)), found.alternatives
    compliance = found.parameters["yielding_edge"]["compliance"]
    # The laboratory's layer at the edge is of first order in ℓ: it misses 2 % of what is uneven at
    # ℓ = 1 µm, of which the fitted ℓ takes a part that counts twice in λ
    assert abs(compliance.value - truth) < 4 * compliance.sd + 0.04 * truth
    own = {trial.causes: trial.chi2 for trial in found.trials}["yielding_edge",]
    for name, sigmas in zip(RIVALS, least, strict=True):
        rival = diagnose(tmp_path / "a.nc", effects=[library()[name]])
        assert rival.verdict == "unexplained"
        # Where the length of bending, which the base model fits, says no more, it is not tried
        misfit = min(trial.chi2 for trial in rival.trials)
        assert misfit > own + sigmas**2, name
