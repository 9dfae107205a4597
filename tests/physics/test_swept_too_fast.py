"""Sweeps too fast for the mode or for the filter of the lock-in, integrated in time."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from numba import njit
from scipy.stats import gamma

from femnl import load
from femnl.effects import library
from femnl.fits.response.pose import pose
from femnl.io import measurement
from femnl.observe.film import SimulatedFilm
from tests.physics.driven_sweeps import (
    ALPHA,
    F0,
    NOISE,
    STRONGEST,
    WAVELENGTH,
    Array,
    Bench,
    Complex,
)

SUBSTEPS = 400
"""Steps of time a point."""


class Flow(NamedTuple):
    """f of each point and of resonance [Hz], direction, push [m Hz], bend [Hz/m²], width [Hz]."""

    f: Array
    resonance: float
    direction: Array
    push: Array
    bend: float
    width: float


@njit(error_model="numpy")
def _integrated(out: Complex, flow: Flow, rest: float) -> None:
    """Step ȧ = 2πi((f₀ + bend|a|² − f + iw/2)a − push) at each f for a time `rest`."""
    f, resonance, direction, push, bend, width = flow
    h = rest / SUBSTEPS
    for s in range(len(push)):
        a = 0j
        for n in range(len(f)):
            k = n if direction[s] > 0 else len(f) - 1 - n
            # The first point is taken once the mode has settled.
            for _ in range(SUBSTEPS * (200 if n == 0 else 1)):
                z = a
                total = 0j
                for stage in range(4):
                    own = resonance - f[k] + bend * abs(z) ** 2 + 0.5j * width
                    rate = 2j * np.pi * (own * z - push[s])
                    total += rate if stage in (0, 3) else 2 * rate
                    z = a + (h if stage == 2 else h / 2) * rate
                a = a + h / 6 * total
            out[s, k] = a


def integrated(bench: Bench, rest: float) -> Complex:
    """Return the motion [m] at the end of each point, which takes `rest` [s]."""
    out = np.empty((len(bench.drives), bench.points), complex)
    push = bench.width / 2 * bench.peak * bench.drives
    flow = Flow(bench.frequency, F0, bench.direction, push, 0.375 * F0 * ALPHA, bench.width)
    _integrated(out, flow, rest)
    return out


def filtered(bench: Bench, volts: Complex, tau: float, poles: int) -> Complex:
    """Return the output of a chain of RC stages; τ [points]."""
    out = np.empty_like(volts)
    for s, way in enumerate(bench.direction):
        order = np.arange(bench.points)[:: int(way)]
        state = np.full(poles, volts[s, order[0]])
        for k in order:
            for _ in range(SUBSTEPS):
                # By the midpoint rule
                before = np.concatenate([[volts[s, k]], state[:-1]])
                half = state + (before - state) / (2 * tau * SUBSTEPS)
                before = np.concatenate([[volts[s, k]], half[:-1]])
                state = state + (before - half) / (tau * SUBSTEPS)
            out[s, k] = state[-1]
    return out


@pytest.mark.slow
@pytest.mark.parametrize(("tau", "poles"), [(0.5, 1), (0.3, 4)])
def test_a_slow_filter_is_named_with_what_it_keeps(tau: float, poles: int, tmp_path: Path) -> None:
    bench = Bench()
    volts = filtered(bench, bench.volts(bench.amplitude()), tau, poles)
    found = bench.diagnose(tmp_path / "a.nc", volts)
    assert (found.verdict, found.causes) == ("explained", ("lock_in_filter",)), (
        found.where,
        found.alternatives,
    )
    own = found.parameters["lock_in_filter"]
    assert own["poles"].value == poles
    left = 1 - gamma.cdf(1 / tau, poles)  # of a step: RC stages add up as waiting times do
    assert own["kept"].value == pytest.approx(left, abs=4 * own["kept"].sd + 1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("stretch", [0.3, 0.6])
def test_a_mode_that_does_not_settle_is_named_with_its_decay(
    stretch: float, tmp_path: Path
) -> None:
    bench = Bench(stretch=stretch)
    kept = 0.3
    volts = bench.volts(integrated(bench, -np.log(kept) / (np.pi * bench.width)))
    found = bench.diagnose(tmp_path / "a.nc", volts)
    assert (found.verdict, found.causes) == ("explained", ("unsettled_mode",)), (
        found.where,
        found.alternatives,
    )
    own = found.parameters["unsettled_mode"]["kept"]
    assert own.value == pytest.approx(kept, abs=4 * own.sd)


def test_the_motion_of_a_fast_sweep_is_known_through_its_jumps() -> None:
    bench = Bench(stretch=6.0)
    kept = 0.3
    motion = integrated(bench, -np.log(kept) / (np.pi * bench.width))
    volts = bench.volts(motion)
    data = measurement.response(
        bench.frequency,
        volts,
        noise_sd=NOISE,
        wavelength=WAVELENGTH,
        mode="2,2",
        drive=bench.drives,
        direction=bench.direction,
    )
    model = pose(data, SimulatedFilm(load("square-270um"), 12))
    metre = np.sqrt(ALPHA / model.simulated_alpha)
    base = {
        "frequency": F0,
        "linewidth": bench.width,
        "peak": bench.peak * metre,
        "height": STRONGEST / np.abs(motion).max() * bench.peak,
        "phase": 0.4,
    }
    found = model.predict([library()["unsettled_mode"]], base, [{"kept": kept}])
    np.testing.assert_allclose(found, volts.ravel(), atol=6 * NOISE)
    assert np.sqrt(np.mean(np.abs(found - volts.ravel()) ** 2)) < NOISE / 2
