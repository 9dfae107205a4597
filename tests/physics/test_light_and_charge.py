"""Light and charge on a film, against motion in time and full energies."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from femnl.core.stages import Points
from femnl.device.geometry import load
from femnl.effects import library

FILM = load("square-270um").film


@pytest.mark.parametrize(("spring", "turn"), [(1e-3, 0.3), (-1e-3, 1.0), (2e-3, 0.0)])
def test_a_force_of_light_that_lags_is_a_spring_and_undoes_damping(
    spring: float, turn: float
) -> None:
    power = np.array([0.0, 1.0])
    points = Points(np.ones(2), np.full(2, 50.0), {"laser_power": power})
    found = library()["optical_spring"].changes["points"](
        points, {"spring": spring, "loss": -turn * spring * 50.0}
    )
    omega = 2 * np.pi
    whole = spring * (1 + turn**2)

    def motion(t: float, s: np.ndarray[tuple[int], np.dtype[np.float64]]) -> list[float]:
        x, v, force = s
        push = whole * x if turn == 0 else force
        rate = 0.0 if turn == 0 else (whole * x - force) * omega / turn
        return [v, -(omega**2) * (x + push) - omega / 50.0 * v, rate]

    def crossing(t: float, s: np.ndarray[tuple[int], np.dtype[np.float64]]) -> float:
        return float(s[0])

    # Steps of the rise through zero, 20 periods apart
    vars(crossing)["direction"] = 1.0
    run = solve_ivp(
        motion, (0, 42), [0.0, 1.0, 0.0], "DOP853", events=crossing, rtol=1e-11, atol=1e-13
    )
    assert run.t_events is not None
    assert run.y_events is not None
    times = run.t_events[0]
    speeds = run.y_events[0][:, 1]
    rate = 20 / (times[-1] - times[-21])
    decay = np.log(speeds[-21] / speeds[-1]) / (times[-1] - times[-21])
    # A free motion of Q = 50 is slower by 1/8Q²
    assert rate * (1 + 1 / (8 * 50**2)) == pytest.approx(found.frequency[1], rel=2e-5)
    assert decay / (np.pi * rate) == pytest.approx(1 / found.quality_factor[1], rel=5e-3)


def test_light_on_a_nodal_line_exerts_no_force() -> None:
    points = Points(np.ones(2), np.ones(2), {"laser_power": np.array([0.0, 1.0])}, spot=0.0)
    found = library()["optical_spring"].changes["points"](points, {"spring": 0.1, "loss": 0.5})
    np.testing.assert_array_equal(found.frequency, points.frequency)


def test_heat_never_stiffens() -> None:
    (softening,) = (s for s in library()["photothermal"].parameters if s.name == "softening")
    assert softening.low == 0
    points = Points(np.ones(5), np.ones(5), {"laser_power": np.linspace(0, 1, 5)})
    found = library()["photothermal"].changes["points"](points, {"softening": 0.1, "loss": 0.0})
    assert np.all(np.diff(found.frequency) < 0)


def test_a_voltage_softens_a_plate_as_its_energy_says() -> None:
    gap = 3.2e-6
    frequency = 1.5e6
    stiffness = FILM.density * FILM.thickness * (2 * np.pi * frequency) ** 2
    permittivity = 8.8541878128e-12
    voltage = np.linspace(-8, 8, 9)
    offset = 1.3

    def square(volts: float) -> float:
        # k q = ε₀V²/(2(d − q)²) at rest, of curvature k − ε₀V²/(d − q)³
        pull = permittivity * (volts - offset) ** 2
        rest = brentq(lambda q: stiffness * q - pull / (2 * (gap - q) ** 2), 0, gap / 3)
        return 1 - pull / (gap - rest) ** 3 / stiffness

    exact = np.sqrt([square(v) / square(0.0) for v in voltage])
    points = Points(np.ones(9), np.ones(9), {"voltage": voltage})
    softening = permittivity / (stiffness * gap**3)
    found = library()["electrostatic_softening"].changes["points"](
        points, {"softening": softening, "offset": offset}
    )
    np.testing.assert_allclose(found.frequency - 1, exact - 1, rtol=1e-2, atol=1e-12)
