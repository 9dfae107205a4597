"""The fringe of a stack: its closed form, and a focused beam as a sum of plane waves."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from tmm import coh_tmm

from femnl.core.device import Stack
from femnl.core.stages import Fringe, Motion, Wave
from femnl.device.geometry import load
from femnl.effects import library
from femnl.optics.airy import Film, beam_waves, geometric_fringe
from femnl.optics.fringe import MultilayerFringe
from femnl.optics.sampled import harmonics
from tests.blind.lab.optics import beam_reflection, fringe, with_film

Array = NDArray[np.float64]
WAVELENGTH = 632.8e-9
THICKNESS = 183.75e-9
GAP = 3226.25e-9
U = np.linspace(-4.5e-7, 4.5e-7, 401)


@pytest.fixture(scope="module")
def stack() -> Stack:
    found = load("square-270um").stack
    assert found is not None
    return found


def aperture_square(waist: float) -> float:
    return float((WAVELENGTH / (np.pi * waist)) ** 2)


def volts(waves: tuple[Wave, ...], u: Array) -> Array:
    """Re Σ_k c_k e^{ikqu}, of all waves."""
    total = np.zeros(len(u))
    for wave in waves:
        turns = np.outer(u, np.arange(len(wave.coefficients)))
        total += (np.exp(4j * np.pi / wave.wavelength * turns) @ wave.coefficients).real
    return total


def left(found: Array, exact: Array) -> float:
    """Largest deviation once the detector's gain and offset are fitted."""
    columns = np.column_stack([found, np.ones(len(found))])
    gain, *_ = np.linalg.lstsq(columns, exact, rcond=None)
    return float(np.abs(columns @ gain - exact).max())


@pytest.mark.parametrize(("thickness", "scale"), [(183.75e-9, 1.0), (186e-9, 1.03), (90e-9, 0.97)])
def test_overtones_fall_by_one_ratio_as_transfer_matrices_say(
    stack: Stack, thickness: float, scale: float
) -> None:
    other = with_film(stack, {"thickness": thickness, "index_scale": scale})
    sampled = MultilayerFringe(other, WAVELENGTH).fourier.coefficients
    closed = geometric_fringe(stack, WAVELENGTH, Film(thickness, scale)).coefficients(
        4 * np.pi * GAP / WAVELENGTH
    )
    count = min(len(sampled), len(closed))
    np.testing.assert_allclose(closed[1:count], sampled[1:count], atol=1e-13)


@pytest.mark.parametrize("s_wave", [True, False])
def test_a_wave_at_an_angle_reflects_as_transfer_matrices_say(stack: Stack, s_wave: bool) -> None:
    sine = 0.2
    layers = [layer.thickness for layer in stack.layers]
    index = [complex(dict(layer.index)[WAVELENGTH]).conjugate() for layer in stack.layers]
    angle = float(np.arcsin(sine))
    exact = []
    for u in U[::8]:
        moved = [*layers[:2], GAP + u, *layers[3:]]
        exact.append(coh_tmm("s" if s_wave else "p", index, moved, angle, WAVELENGTH)["R"])
    one = geometric_fringe(stack, WAVELENGTH, Film(THICKNESS), sine**2, s_wave=s_wave)
    cosine = np.sqrt(1 - sine**2)
    series = one.coefficients(4 * np.pi * GAP * cosine / WAVELENGTH)
    found = volts((Wave(series, WAVELENGTH / cosine),), U[::8])
    assert np.ptp(found - np.array(exact)) < 1e-8


@pytest.mark.parametrize(
    ("waist", "error"), [(10e-6, 1e-7), (2.5e-6, 1e-6), (1.5e-6, 1e-4), (1.2e-6, 1e-3)]
)
def test_a_focused_beam_reads_its_plane_waves(stack: Stack, waist: float, error: float) -> None:
    square = aperture_square(waist)
    exact = fringe(stack, {"gap": GAP, "aperture_square": square}, WAVELENGTH)(GAP + U)
    found = volts(beam_waves(stack, WAVELENGTH, Film(THICKNESS), GAP, square), U)
    assert left(found, exact) < error
    # A plane wave of the best gain misses 0.9 % of it at 10 µm, and 15 % at 2.5 µm.
    plane = volts(beam_waves(stack, WAVELENGTH, Film(THICKNESS), GAP, 0.0), U)
    assert left(plane, exact) > 20 * error


def test_overtones_of_a_focused_beam_are_weaker_and_turned_by_the_overlap_of_the_beam(
    stack: Stack,
) -> None:
    # Film and wafer without depth of their own: the published overlap 1/(1 + ikd/z_R) of a
    # Gaussian beam with itself after 2kd, by quadrature over the laboratory's reflections.
    square = aperture_square(4e-6)
    depth = np.pi * GAP * square / WAVELENGTH
    gap = GAP + WAVELENGTH / 2 * (np.arange(256) / 256 - 0.5)
    k = np.arange(1, 4)
    turns = np.exp(-4j * np.pi / WAVELENGTH * np.outer(k, gap))
    plane = turns @ beam_reflection(stack, gap, WAVELENGTH, 0.0) / 128
    beam = turns @ beam_reflection(stack, gap, WAVELENGTH, square) / 128
    waves = beam_waves(stack, WAVELENGTH, Film(THICKNESS), GAP, square)
    size = max(len(wave.coefficients) for wave in waves)
    total = np.sum([np.pad(w.coefficients, (0, size - len(w.coefficients))) for w in waves], axis=0)
    alone = beam_waves(stack, WAVELENGTH, Film(THICKNESS), GAP, 0.0)[0].coefficients
    ratio = total[1:4] / total[1] / (alone[1:4] / alone[1])
    overlap = (1 + 1j * depth) / (1 + 1j * k * depth)
    np.testing.assert_allclose(ratio, overlap, atol=5e-3)
    np.testing.assert_allclose(beam / beam[0] / (plane / plane[0]), overlap, atol=2e-2)


@pytest.mark.parametrize("limit", [np.inf, 0.7])
def test_harmonics_under_a_focused_beam_are_those_of_its_sampled_signal(
    stack: Stack, limit: float
) -> None:
    square = aperture_square(2.5e-6)
    amplitude = np.array([5e-8, 2e-7, 4e-7])
    swing = amplitude * np.exp(0.7j)
    motion = Motion(
        swing[None],
        np.zeros(3),
        np.zeros(3),
        np.zeros(3),
        np.ones((12, 3)),
        np.arange(1.0, 13.0),
        0,
        swing,
        WAVELENGTH,
    )
    values = {"gap": GAP, "thickness": THICKNESS, "index_scale": 1.0, "aperture_square": square}
    plain = Fringe(np.array([0, 1 + 0j]), WAVELENGTH, stack)
    lit = library()["multilayer_fringe"].changes["fringe"](plain, values)
    lit = replace(lit, limit=limit, floor=-limit)
    order = np.arange(1, 7)
    found = harmonics(motion, lit, order)
    tau = 2 * np.pi * np.arange(2048) / 2048
    u = amplitude[:, None] * np.cos(tau + 0.7)
    v = fringe(stack, values, WAVELENGTH)(GAP + u)
    if np.isfinite(limit):
        period = GAP + WAVELENGTH / 2 * np.arange(4096) / 4096
        top = limit * np.abs(fringe(stack, values, WAVELENGTH)(period)).max()
        v = np.clip(v, -top, top)
    exact = np.fft.fft(v)[:, 1:7].T / 1024
    # The clipping level hangs on the mean of the fringe, which a beam's slow decay shifts.
    np.testing.assert_allclose(found, exact, atol=3e-4 if np.isinf(limit) else 2e-2)
