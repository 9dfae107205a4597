"""Fits of the film to spectra whose wave speed and scatter are known."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import binom

from femnl.core.device import Film
from femnl.core.errors import MeasurementError
from femnl.fits.spectrum.film import fit_film
from femnl.io.measurement import spectrum

Array = NDArray[np.float64]
FILM = Film(thickness=1e-7, young=2.5e11, poisson=0.23, density=3000.0, stress=1e9)
PAIRS = [(1, 1), (1, 2), (2, 1), (2, 2), (1, 3), (3, 1), (2, 3), (3, 2), (3, 3)]
# An oblong membrane, so that no two modes are degenerate.
SIMULATED = 1e6 * np.array([np.hypot(m, 1.03 * n) for m, n in PAIRS])
LABELS = [f"({m},{n})" for m, n in PAIRS]
PLAIN = [label.strip("()") for label in LABELS]


def lines(seed: int, scatter: float, sd: float = 5.0) -> Array:
    """Lines of a film in which waves run 5 % faster."""
    rng = np.random.default_rng(seed)
    return np.asarray(
        1.05 * SIMULATED * (1 + scatter * rng.normal(size=len(PAIRS)))
        + sd * rng.normal(size=len(PAIRS))
    )


def test_speed_and_stress_follow_from_the_scale() -> None:
    found = fit_film(spectrum(lines(1, 0.0), np.full(9, 5.0), PLAIN), LABELS, SIMULATED, FILM).fit
    assert abs(found["scale"] - 1.05) < 4 * found.parameters["scale"].sd
    assert found["wave_speed"] == pytest.approx(found["scale"] * np.sqrt(1e9 / 3000))
    assert found["stress"] == pytest.approx(found["scale"] ** 2 * 1e9)
    assert found.parameters["stress"].sd / found["stress"] == pytest.approx(
        2 * found.parameters["scale"].sd / found["scale"]
    )
    assert found["scatter"] < 1e-5


def test_the_error_of_the_scale_holds_with_and_without_scatter_of_the_modes() -> None:
    for scatter in (0.0, 1e-3):
        inside = 0
        for seed in range(200):
            fit = fit_film(
                spectrum(lines(seed, scatter), np.full(9, 5.0), PLAIN), LABELS, SIMULATED, FILM
            ).fit
            inside += abs(fit["scale"] - 1.05) < fit.parameters["scale"].sd
        # A scatter estimated from nine modes makes the interval Student's with 8 degrees of
        # freedom: 65 % instead of 68 %.
        assert binom.ppf(0.001, 200, 0.655) <= inside <= binom.ppf(0.999, 200, 0.655), (
            f"{inside} of 200 at scatter {scatter}"
        )


def test_the_scatter_of_the_modes_is_what_was_put_in() -> None:
    found = [
        fit_film(spectrum(lines(seed, 2e-3), np.full(9, 5.0), PLAIN), LABELS, SIMULATED, FILM).fit[
            "scatter"
        ]
        for seed in range(100)
    ]
    assert np.mean(np.square(found)) == pytest.approx(4e-6, rel=4 * np.sqrt(2 / 8 / 100))


def test_a_spectrum_without_labels_is_assigned_first() -> None:
    given = np.random.default_rng(2).permutation(lines(3, 1e-4))
    found = fit_film(spectrum(given, np.full(9, 5.0)), LABELS, SIMULATED, FILM)
    assert found.assignment is not None
    assert list(found.label) == [LABELS[k] for k in np.argsort(SIMULATED)]
    np.testing.assert_array_equal(found.frequency, np.sort(given))
    assert found.fit["scale"] == pytest.approx(1.05, rel=1e-3)


def test_lines_that_the_simulation_does_not_know_are_left_out_and_told() -> None:
    labels = [*PLAIN[:-1], "7,9"]
    found = fit_film(spectrum(lines(4, 0.0), np.full(9, 5.0), labels), LABELS, SIMULATED, FILM)
    assert len(found.label) == 8
    assert any("1 lines without a simulated mode" in note for note in found.fit.notes)
    with pytest.raises(
        MeasurementError, match="none of its lines has a simulated mode; check the labels"
    ):
        fit_film(spectrum([1e6], [5.0], ["7,9"]), LABELS, SIMULATED, FILM)
