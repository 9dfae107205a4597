"""The virtual laboratory itself.

Its films, fringes and sizes in σ against closed forms, and its files, from the seed alone.
"""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from numpy.polynomial.legendre import Legendre, leggauss
from scipy.interpolate import make_interp_spline
from scipy.linalg import eigh
from scipy.special import jv

from femnl.device import geometry
from femnl.effects import library
from femnl.io import measurement
from femnl.mechanics.modes import shape_at
from femnl.observe.film import SimulatedFilm
from femnl.optics.fringe import MultilayerFringe
from femnl.pipeline import solve_modes
from tests.blind.jobs import IMPOSSIBLE, jobs
from tests.blind.lab import KINDS, Case, causes, make, maps
from tests.blind.lab.bench import FOLLOWED, Array, Cause, Noise, Values, sizes
from tests.blind.lab.drum import drum
from tests.blind.lab.film import Membrane, device, membrane
from tests.blind.lab.holes import SIDE, HolesBench, perforated
from tests.blind.lab.maps import WAVELENGTH
from tests.blind.lab.motion import bent
from tests.blind.lab.optics import reflection
from tests.blind.lab.record import COUNT, RATE, SUBSTEPS, RecordBench
from tests.blind.lab.response import ResponseBench
from tests.blind.lab.spectrum import SpectrumBench
from tests.blind.lab.trace import TraceBench
from tests.blind.realistic.files import Draw, prepared

HEXAGON = np.array(
    [
        7.155339133926055,
        18.131677865531,
        18.131677865531,
        32.4518575144,
        32.4518575144,
        37.491352876798,
    ]
)
"""Eigenvalues of −Δ on the regular hexagon of side 1, from the literature that the validation case
of the ideal hexagon cites.
"""


@pytest.mark.slow
def test_the_laboratory_s_hexagon_has_the_eigenvalues_of_the_ideal_one() -> None:
    film = membrane("hexagon-278um", 0.0)
    assert film.square[:6] * film.half**2 == pytest.approx(HEXAGON, rel=2e-8)


def test_the_boundary_layer_of_a_square_plate_gives_its_published_frequencies() -> None:
    # Clamped square plate, Ta²/D = 10⁵: ω a² √(ρh/D) = 1414.0449 (Ritz and Argyris elements agree
    # on it), ℓ/a = 10^−2.5.
    side = geometry.load("square-270um").outline.length
    layer = side / np.sqrt(1e5)
    k2 = float(membrane("square-270um", layer).clamped(layer).min())
    assert np.sqrt((k2 + layer**2 * k2**2) * 1e5) * side == pytest.approx(1414.0449, rel=2e-6)


def test_the_laboratory_s_stack_reflects_as_transfer_matrices_say() -> None:
    stack = geometry.load("square-270um").stack
    assert stack is not None
    u = np.linspace(-2e-7, 2e-7, 9)
    gap = stack.layers[stack.gap].thickness
    assert reflection(stack, gap + u, WAVELENGTH) == pytest.approx(
        MultilayerFringe(stack, WAVELENGTH)(u), rel=1e-10
    )


@pytest.mark.slow
def test_the_laboratory_s_film_with_holes_bends_as_femnl_s_does() -> None:
    model = device("perforated")
    other = perforated()
    film = model.film
    layer = film.thickness * np.sqrt(film.young / (12 * (1 - film.poisson**2) * film.stress))
    plate = other.clamped(layer)
    theirs = np.sort(np.sqrt(film.stress / film.density * (plate + layer**2 * plate**2)))[:14] / (
        2 * np.pi
    )
    ratio = theirs / solve_modes(model, 20, resolution=1.5).frequency[:14]
    assert ratio.mean() == pytest.approx(1, abs=2e-6)
    # c is free in a diagnosis, so that a common factor says nothing; the rest is to be well below
    # the smallest noise, 2 Hz times `less`.
    assert np.abs(theirs * (ratio / ratio.mean() - 1)).max() < 0.5 * 2.0 * HolesBench.less


def test_the_laboratory_s_film_leaves_its_clamped_edge_as_femnl_s_does() -> None:
    name = "square-270um"
    model = device(name)
    modes = solve_modes(model, 1)
    up = np.linspace(-135e-6, 0, 400)
    places = (np.zeros_like(up), up)
    film = model.film
    layer = film.thickness * np.sqrt(film.young / (12 * (1 - film.poisson**2) * film.stress))
    theirs = membrane(name, layer).held(*places, 1, layer)[0]
    own = shape_at(modes, 0, *places)
    # Finite elements make the layer itself, some 0.8 µm, to 1e-5 of the largest deflection.
    assert np.abs(theirs / theirs[-1] - own / own[-1]).max() < 2e-5


@pytest.mark.slow
def test_the_laboratory_s_film_with_holes_has_the_shapes_of_femnl_s_beside_the_holes() -> None:
    model = device("perforated")
    film = model.film
    half = SIDE / 2
    layer = film.thickness * np.sqrt(film.young / (12 * (1 - film.poisson**2) * film.stress))
    other, x, y = (
        drum(layer),
        *(part.ravel() for part in np.meshgrid(*[np.linspace(-half, half, 60)] * 2)),
    )
    seen = ~other.over_hole(x, y)
    assert 0.9 < seen.mean() < 0.95
    theirs = other.held(x[seen], y[seen], 4, layer)
    modes = solve_modes(model, 4)
    for k in (0, 3):  # those between are one pair, of which any two are modes
        own = shape_at(modes, k, x[seen], y[seen])
        size = float(theirs[k] @ own / (own @ own))
        # A tenth of the noise of a map in each harmonic, at z = 6 under a fringe of 20 mV.
        assert np.abs(theirs[k] / size - own).max() < 2.5e-4


@pytest.mark.parametrize(
    "kind", ["spectrum", pytest.param("map", marks=pytest.mark.slow), "series", "trace"]
)
def test_causes_are_as_large_as_asked_for(kind: str, tmp_path: Path) -> None:
    for cause in causes(kind):
        sigma = make(Case(kind, (cause,), 5, size=(20.0, 20.1)), tmp_path / "file.nc")["sigma"][
            cause
        ]
        assert sigma == pytest.approx(20, rel=0.35) or cause in (
            "multilayer_fringe",
            "finite_spot",
            "frame_mode",
            "gas_damping",  # as large as molecules make it
            "bending_stiffness",  # no larger than what is known of films allows to see
        ), cause


UNHIDDEN = {
    ("trace", name)
    for name in ("phase_tilt", "static_bow", "mode_admixture", "resonance_drift", "doublet")
}
"""What one spot cannot show: the gap, the fringe and the amplitude there take it up."""


def test_the_laboratory_hides_every_cause_in_every_kind_of_data_that_shows_it() -> None:
    told = {(kind, effect.name) for effect in library().values() for kind in effect.kinds}
    hidden = {
        ("spectrum" if kind in ("holes", "electrode") else kind, cause)
        for kind in KINDS
        for cause in causes(kind)
    }
    assert told - hidden == UNHIDDEN
    assert {(kind, cause) for kind, cause in hidden if kind not in ("lasers", "device")} <= told


def test_every_geometry_comes_up_and_no_round_repeats_another() -> None:
    draws = jobs(seed=1, rounds=8)
    assert {job.case.geometry for job in draws if job.case.kind == "map"} == {
        "square-270um",
        "rectangle",
        "hexagon-278um",
        "perforated",
    }
    assert {
        job.case.causes[0] for job in draws if job.task == "hidden" and job.case.kind == "device"
    } == {cause for cause in causes("device") if (cause, "square-270um") not in IMPOSSIBLE}
    assert len({job.name for job in draws}) == len(draws)


def stiff_string(
    layer: float, depth: float, n: int = 130
) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Return (ω/c)² of a stiff string of length 1 by Legendre–Ritz.

    Springs 1/δ hold its ends, and nothing turns them.
    """
    bubble = Legendre([2 / 3, 0, -2 / 3])
    slopes = [Legendre([0.0]), *(bubble * Legendre.basis(j) for j in range(n))]
    shapes = [Legendre([1.0]), *(slope.integ() for slope in slopes[1:])]
    t, w = leggauss(2 * n)
    v, s, c, e = (
        np.array([f(at) for f in rows]) * 2**d
        for rows, at, d in (
            (shapes, t, 0),
            (slopes, t, 1),
            ([f.deriv() for f in slopes], t, 2),
            (shapes, np.array([-1.0, 1.0]), 0),
        )
    )
    scale = 1 / np.sqrt((v**2) @ w + 1e-3 * (c**2) @ w)[:, None]
    v = v * scale
    s = s * scale
    c = c * scale
    e = e * scale
    stiffness = (s * w / 2) @ s.T + layer**2 * (c * w / 2) @ c.T + e @ e.T / depth
    return np.asarray(eigh(stiffness, (v * w / 2) @ v.T, eigvals_only=True)[:4])


@pytest.mark.parametrize("depth", [5e-3, 3e-2])
def test_an_edge_of_the_laboratory_that_gives_way_but_does_not_turn_does_so_exactly(
    depth: float,
) -> None:
    layer = 1e-2
    orders = np.array([(m, 0) for m in range(1, 5)])
    length = 1 + 2 * (depth - layer)
    none = np.zeros((4, 4))
    film = Membrane((none, none, none), 1.0, 0.5, orders, (length, 1e9), None)
    k2 = film.clamped(layer, depth)
    assert k2 + layer**2 * k2**2 == pytest.approx(stiff_string(layer, depth), rel=5e-7)


def test_a_force_of_second_order_bends_the_laboratory_s_motion_as_series_say() -> None:
    # Nayfeh & Mook (1979), section 2.3: at rest −κ/2 and at twice the drive κ/6 of it.
    series = np.fft.rfft(bent(0.02, 96)) / 96
    assert series[0].real == pytest.approx(-0.01, rel=1e-3)
    assert 2 * series[1] == pytest.approx(1, abs=1e-9)
    assert 2 * series[2] == pytest.approx(0.02 / 6, rel=1e-3)


def test_sweeps_of_the_laboratory_end_where_the_forces_of_both_modes_balance() -> None:
    bench = ResponseBench("square-270um", ("internal_resonance",), np.random.default_rng(3))
    base = bench.draw(np.random.default_rng(1))
    base |= {name: 1.0 for name in base if name.startswith("gain")}
    base |= {name: 0.0 for name in base if name.startswith("phase")}
    f0 = base["frequency"]
    w = base["linewidth"]
    alpha = base["alpha"]
    for order in (2.0, 3.0):
        values = {
            "coupling_square": 0.3 * w**2,
            "offset": 0.5 * w,
            "width": 0.6 * w,
            "order": order,
        }
        a = bench._swept([base], [{"internal_resonance": values}])[0]
        square = 8 * w / (3 * f0 * alpha)
        crossing = bench.frequency[[0, -1]].mean() + 0.5 * w
        pull = (
            -values["coupling_square"]
            / (crossing - bench.frequency + 0.5j * values["width"])
            * (np.abs(a) ** 2 / square) ** (order - 1)
        )
        left = a * (f0 * (1 + 0.375 * alpha * np.abs(a) ** 2) + pull - bench.frequency + 0.5j * w)
        force = w / 2 * base["peak"] * bench.drives[:, None]
        assert np.abs(left / force - 1).max() < 1e-3
        assert np.abs(pull).max() > 0.1 * w


def test_traces_of_the_laboratory_have_the_harmonics_of_bessel() -> None:
    bench = TraceBench("square-270um", np.random.default_rng(2))
    base = bench.draw(np.random.default_rng(3))
    volts = bench._sampled(base, {})[0]
    phase = (
        2 * np.pi * bench.frequency[0] * np.arange(bench.samples) / bench.rate + base["phase[0]"]
    )
    z = 4 * np.pi / WAVELENGTH * base["amplitude[0]"]
    exact = np.cos(base["theta"]) * jv(0, z) * np.ones(bench.samples)
    for n in range(1, 30):
        # cos(z cos φ + θ) = Σ J_n(z) cos(nφ) cos(θ + nπ/2), twice for n > 0
        exact += 2 * jv(n, z) * np.cos(n * phase) * np.cos(base["theta"] + n * np.pi / 2)
    assert volts == pytest.approx(base["contrast"] * exact, abs=1e-12)


def test_records_of_the_laboratory_follow_their_equation() -> None:
    bench = RecordBench(np.random.default_rng(2))
    base = bench.draw(np.random.default_rng(3))
    hidden = {"quadratic_stiffness": {"kappa2": 0.3}, "nonlinear_damping": {"eta": 20.0}}
    y = make_interp_spline(np.arange(COUNT) / RATE, bench._run([base], [hidden])[0], k=7)
    t = (np.arange(200, 1700) + 0.5) / RATE
    u = np.interp(2 * SUBSTEPS * RATE * t, np.arange(len(bench.drive)), bench.drive)
    square = (2 * np.pi * base["frequency"]) ** 2
    force = square * (
        (u + base["offset"]) / base["stiffness"]
        - y(t)
        - 0.3 * y(t) ** 2
        - base["alpha"] * y(t) ** 3
    )
    loss = 2 * np.pi * base["linewidth"] * (1 + 20 * y(t) ** 2) * y(t, 1)
    # What is left is the spline: ten samples a period.
    assert np.std(y(t, 2) - force + loss) < 0.02 * np.std(force)


def test_files_of_several_measurements_hold_one_motion(tmp_path: Path) -> None:
    truth = make(Case("lasers", ("phase_tilt",), 3), tmp_path / "file.nc")
    tree = measurement.read(tmp_path / "file.nc")
    assert set(tree.children) == {"red", "green"}
    assert tree["red"].attrs["drive_frequency"] == tree["green"].attrs["drive_frequency"]
    assert "amplitude" in truth["base"]
    assert truth["base"]["red.theta"] != truth["base"]["green.theta"]


def test_a_uniform_change_of_all_frequencies_is_no_cause() -> None:
    rng = np.random.default_rng(4)
    bench = SpectrumBench("square-270um", ("frequency_drift",), rng)
    base = bench.draw(rng)
    faster, plain = bench.clean([(base | {"speed": 1.001 * base["speed"]}, {}), (base, {})])
    assert faster[:-1] / plain[:-1] == pytest.approx(np.full(bench.count, 1.001), rel=1e-12)


def test_a_seed_draws_the_same_file_again(tmp_path: Path) -> None:
    case = Case("spectrum", ("added_mass",), 9)
    assert make(case, tmp_path / "one.nc") == make(case, tmp_path / "two.nc")
    assert make(Case("spectrum", ("added_mass",), 10), tmp_path / "three.nc") != make(
        case, tmp_path / "two.nc"
    )


@pytest.mark.parametrize(
    "name",
    [
        "square-270um",
        *(pytest.param(n, marks=pytest.mark.slow) for n in ("rectangle", "hexagon-278um")),
    ],
)
def test_shapes_of_the_laboratory_have_the_layer_of_a_plate_at_its_edge(name: str) -> None:
    film = SimulatedFilm(geometry.load(name), 12)
    x, y = np.random.default_rng(1).uniform(-1, 1, (2, 2000)) * film.projection.reach
    made = maps._shapes(name, x.tobytes(), y.tobytes())[0]
    there = shape_at(film.modes, 0, x, y)
    assert np.abs(made * np.sign(made @ there) - there).max() < 1e-3


class Root:
    """A base parameter b whose square a cause adds to.

    The cause can be had by the base alone, but not along its tangent.
    """

    def __init__(self) -> None:
        self.unit = {"b": 1.0}

    def draw(self, rng: np.random.Generator) -> Values:
        return {"b": 1.0}

    def clean(self, variants: list[tuple[Values, dict[str, Values]]]) -> Array:
        total = np.array(
            [base["b"] ** 2 + hidden.get("more", {}).get("c", 0.0) for base, hidden in variants]
        )
        return 100 * np.stack([np.sqrt(total), total, total**2], axis=1)

    def measured(
        self, base: Values, hidden: dict[str, Values], rng: Noise
    ) -> dict[str, xr.Dataset]:
        return {}


def test_a_cause_that_the_base_can_take_up_does_not_stand_out() -> None:
    hidden = {"more": Cause({"c": 0.3}, ("c",))}
    assert sizes(Root(), {"b": 1.0}, hidden)["more"] > 4
    assert sizes(Root(), {"b": 1.0}, hidden, FOLLOWED)["more"] < 1.5


class Spot(Root):
    """Return a cause with a size and a place, beside one that moves what the place moves."""

    def clean(self, variants: list[tuple[Values, dict[str, Values]]]) -> Array:
        rows = []
        for base, hidden in variants:
            size, place = hidden.get("spot", {"size": 0.0, "place": 0.0}).values()
            rows.append(
                [
                    100 * size * np.cos(place),
                    100 * size * np.sin(place) + hidden.get("more", {}).get("c", 0.0),
                    base["b"],
                ]
            )
        return np.array(rows)


def test_a_cause_that_the_place_of_another_can_take_up_does_not_stand_out() -> None:
    more = Cause({"c": 6.0}, ("c",))
    spot = Cause({"size": 1.0, "place": 0.1}, ("size",))
    found = sizes(Spot(), {"b": 1.0}, {"more": more, "spot": spot}, FOLLOWED)
    assert found["more"] < 1e-6
    assert found["spot"] == pytest.approx(100 * np.cos(0.1), rel=1e-6)


def test_what_the_corner_of_a_drive_hides_does_not_count() -> None:
    """Ten times the loss down to e^-1.9 of the energy is over within six points."""
    film = prepared(
        Draw("decay", ("energy_exchange",), "correlated noise", "square-270um", 1818269220)
    )
    assert film.hidden["energy_exchange"]["excess"] == pytest.approx(9.0)
    assert film.sigma["energy_exchange"] < 3
