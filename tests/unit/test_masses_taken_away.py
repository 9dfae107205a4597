"""Films of which a step of a fit takes away more mass than there is."""

from dataclasses import replace

import numpy as np

from femnl import load
from femnl.fits.spectrum.pose import pose
from femnl.io import measurement
from femnl.observe.film import SimulatedFilm
from femnl.observe.spectrum.eigen import eigen, squares


def test_a_film_without_mass_has_frequencies_that_are_no_error() -> None:
    film = SimulatedFilm(load("square-270um"), 12)
    posed = pose(measurement.spectrum(film.modes.frequency[:6], np.full(6, 1.0)), film)
    _, mass, bare = posed._bare(*posed.start)
    shape = bare.projection.at(1e-5, 3e-5)
    gone = replace(bare, mass=bare.mass - 2 * mass[0] * np.outer(shape, shape))
    assert np.linalg.eigvalsh(gone.mass)[0] < 0
    square, vectors = eigen(gone)
    assert np.isfinite(vectors).all()
    np.testing.assert_allclose(squares(gone)[0], square, rtol=1e-6)
    # The mode that has lost its mass is far above all others, which hardly notice
    assert square[-1] > 100 * square[-2]
    assert np.all(square > 0)
