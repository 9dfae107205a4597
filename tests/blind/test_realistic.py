"""The realistic regime: second laws, real noise, true shares, and the events of its score."""

import json
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from femnl.io import measurement
from tests.blind.lab import KINDS, causes, laws
from tests.blind.lab.bench import INEXACT, Array, Noise, Values
from tests.blind.lab.corners import cut
from tests.blind.lab.film import membrane
from tests.blind.lab.laws import LAWS
from tests.blind.realistic import jobs
from tests.blind.realistic.__main__ import known
from tests.blind.realistic.files import Draw, fabricated, make, prepared
from tests.blind.realistic.noise import RealNoise, correlated
from tests.blind.realistic.regimes import REGIMES, Options, drawn
from tests.blind.realistic.score import WORDS, score, table
from tests.blind.realistic.truth import excess, shares

QUICK = [
    ("series", "gas_damping"),
    ("series", "frequency_drift"),
    ("series", "thermal_stress"),
    ("spectrum", "added_mass"),
    ("spectrum", "shear_stress"),
    ("record", "nonlinear_damping"),
    ("trace", "mechanical_overtones"),
    ("map", "static_bow"),
]


def test_every_cause_of_a_kind_has_a_second_law() -> None:
    for kind in jobs.KINDS:
        assert set(causes(kind)) <= LAWS[kind].keys(), kind


@pytest.mark.parametrize(("kind", "cause"), QUICK)
def test_a_second_law_leaves_the_stated_part_of_the_cause(kind: str, cause: str) -> None:
    film = prepared(Draw(kind, (cause,), "inexact", "square-270um", 11))
    left = excess(film.bench, film.base, film.hidden, (cause,))
    whole = excess(film.bench, film.base, film.hidden, ())
    assert np.sqrt(left / whole) == pytest.approx(film.options.deviation, rel=0.35)
    first = {cause: laws.first(film.hidden[cause])}
    assert excess(film.bench, film.base, first, (cause,)) < 1e-6 * whole


@pytest.mark.parametrize(("kind", "cause"), QUICK)
def test_the_first_law_is_a_second_law_of_no_deviation(kind: str, cause: str) -> None:
    film = prepared(Draw(kind, (cause,), "exact", "square-270um", 11))
    none = {cause: film.hidden[cause] | {INEXACT: 0.0}}
    one, two = film.bench.clean([(film.base, film.hidden), (film.base, none)])
    assert np.nanmax(np.abs(one - two)) < 1e-6 * np.nanmax(np.abs(one))


class Line:
    """Three data: the first is the base's, the second a cause's, the third nothing's."""

    def __init__(self) -> None:
        self.unit: Values = {"a": 1.0}

    def draw(self, rng: np.random.Generator) -> Values:
        return {"a": 1.0}

    def clean(self, variants: list[tuple[Values, dict[str, Values]]]) -> Array:
        rows = []
        for base, hidden in variants:
            cause = hidden.get("one", {})
            size = cause.get("size", 0.0)
            rows.append([1 + base["a"], 1 + size, 1 + size * cause.get("inexact", 0.0)])
        return np.array(rows)

    def measured(
        self, base: Values, hidden: dict[str, Values], rng: Noise
    ) -> dict[str, xr.Dataset]:
        return {}


@pytest.mark.parametrize("part", [0.01, 0.2, 0.5])
def test_the_true_share_beside_something_unknown_is_the_closed_form(part: float) -> None:
    base = {"a": 1.0}
    one = {"one": {"size": 50.0}}
    more = np.array([7.0, 0.0, 50.0 * part])
    expected = 1 / (1 + part**2)
    found = shares(Line(), base, one, ("one",), more)["one"]
    assert found["share"] == pytest.approx(expected, rel=1e-9)
    assert found["alone"] == pytest.approx(expected, rel=1e-9)
    # A second law that deviates by as much across what the first can do
    bent = {"one": {"size": 50.0, "inexact": part}}
    found = shares(Line(), base, bent, ("one",))["one"]
    assert found["share"] == pytest.approx(expected, rel=1e-9)
    assert found["left"] == pytest.approx(part / np.hypot(1, part), rel=1e-9)


def test_draws_come_from_the_seed_alone(tmp_path: Path) -> None:
    draw = Draw("series", ("thermal_stress",), "beside unknown", "square-270um", 5)
    one = make(draw, tmp_path / "one.nc")
    two = make(draw, tmp_path / "two.nc")
    assert json.dumps(one) == json.dumps(two)
    assert (tmp_path / "one.nc").read_bytes() == (tmp_path / "two.nc").read_bytes()
    assert jobs.drawn(3, 2) == jobs.drawn(3, 2)
    assert jobs.drawn(3, 2) != jobs.drawn(4, 2)


def test_in_as_many_rounds_as_regimes_every_cause_meets_every_regime() -> None:
    draws = [draw for _, draw in jobs.drawn(1, len(REGIMES))]
    assert len({draw.name for draw in draws}) == len(draws)
    met = {(d.kind, d.causes, d.regime) for d in draws if d.kind == "response" and d.causes}
    assert met == {
        ("response", (cause,), regime) for cause in causes("response") for regime in REGIMES
    }
    first = [draw for k, draw in jobs.drawn(1, 1)]
    assert 60 <= len(first) <= 100


def test_a_cause_that_leaves_nothing_to_see_is_drawn_weaker() -> None:
    """A drift that takes the resonance out of the sweeps, before it has its size."""
    drift = Draw("response", ("frequency_drift",), "correlated noise", "square-270um", 2951386270)
    film = prepared(drift)
    assert np.isfinite(film.hidden["frequency_drift"]["rate"])
    assert np.isfinite(film.sigma["frequency_drift"])


def test_options_are_within_their_ranges_and_of_their_regime_alone() -> None:
    rng = np.random.default_rng(1)
    for regime in REGIMES.values():
        for _ in range(20):
            options = drawn(regime, rng)
            assert (options.stated != 1) == (regime.stated is not None)
            assert (options.glitches > 0) == (regime.glitches is not None)
            assert -0.05 <= options.thickness <= 0.05
            if regime.deviation:
                assert regime.deviation[0] <= options.deviation <= regime.deviation[1]


def test_correlated_noise_has_the_variance_and_the_correlation_that_were_drawn() -> None:
    noise = correlated(np.random.default_rng(1).standard_normal((400, 200)), 0.6)
    assert np.var(noise) == pytest.approx(1, abs=0.02)
    assert np.mean(noise[:, 1:] * noise[:, :-1]) == pytest.approx(0.6, abs=0.02)
    assert np.var(noise[:, 0]) == pytest.approx(1, abs=0.2)


def test_glitches_and_a_wrong_sd_are_what_was_drawn() -> None:
    options = Options(glitches=0.01, glitch_size=(20.0, 900.0), stated=2.0)
    noise = RealNoise("response", options, np.random.default_rng(1))
    found = noise.standard_normal((2, 16, 81))
    size = np.hypot(*found) * options.stated
    assert np.sum(size > 12) == len(noise.glitches) == round(0.01 * 16 * 81)
    assert np.sort(size.ravel())[-1] == pytest.approx(max(noise.glitches), abs=4)
    assert np.std(found[np.broadcast_to(size < 12, found.shape)]) == pytest.approx(0.5, rel=0.05)


def test_a_file_as_fabricated_states_another_film_and_no_other_change() -> None:
    text = '[outline]\nside = "250 um"\n[holes]\nradius = "5 um"\n[film]\nthickness = "30 nm"\n'
    found = fabricated(text, Options(thickness=0.05, radius=-0.02))
    assert found == text.replace('"5 um"', '"4.9 um"').replace('"30 nm"', '"31.5 nm"')


def test_rounded_corners_raise_the_lowest_mode_as_elements_on_such_a_film_do() -> None:
    modes = membrane("square-270um", 0.0)
    side = modes.inner[0]
    raised = cut(modes, 0.2 * side)[0, 0] * side**2
    assert raised == pytest.approx(_rounded(0.2) - 2 * np.pi**2, rel=0.06)


def _rounded(radius: float) -> float:
    """k² of the lowest mode of a unit square with fillets, by elements on a quarter of it."""
    from scipy.sparse.linalg import eigsh
    from skfem import Basis, ElementQuad2, MeshQuad, asm
    from skfem.models.poisson import laplace, mass

    n = 32
    mesh = MeshQuad.init_tensor(np.linspace(0, 1, n + 1), np.linspace(0, 1, n + 1))
    s, turn = mesh.p[0], mesh.p[1] * np.pi / 2
    # From the middle outwards to the edge: half a side, or the arc of the fillet
    cos = np.maximum(np.cos(turn), 1e-12)
    sin = np.maximum(np.sin(turn), 1e-12)
    straight = np.minimum(0.5 / cos, 0.5 / sin)
    centre = 0.5 - radius
    along = centre * (cos + sin)
    inside = np.sqrt(np.maximum(along**2 - 2 * centre**2 + radius**2, 0))
    corner = np.minimum(straight * cos, straight * sin) > centre
    reach = np.where(corner, along + inside, straight)
    hole = 1e-4
    r = hole + s * (reach - hole)
    bent = MeshQuad(np.array([r * np.cos(turn), r * np.sin(turn)]), mesh.t)
    space = Basis(bent, ElementQuad2(), intorder=6)
    outer = mesh.facets_satisfying(lambda p: np.isclose(p[0], 1.0))
    inner = space.complement_dofs(space.get_dofs(outer))
    stiff = asm(laplace, space)[inner][:, inner].tocsc()
    heavy = asm(mass, space)[inner][:, inner].tocsc()
    return float(eigsh(stiff, 1, heavy, sigma=0.0, v0=np.ones(len(inner)))[0][0])


def answer(
    regime: str, hidden: list[str], verdict: str, named: list[str], **more: Any
) -> dict[str, Any]:
    """A result as the study writes it."""
    about = {
        "name": f"{regime} {hidden} {verdict} {named}",
        "kind": "series",
        "regime": regime,
        "causes": hidden,
        "sigma": dict.fromkeys(hidden, 100.0),
        "shares": {name: {"share": 0.9} for name in hidden},
        "glitches": [],
        "verdict": verdict,
        "named": named,
        "alternatives": [named],
        "seconds": 1.0,
    }
    return about | more


def rate(board: dict[str, Any], name: str, by: str = "", value: str = "") -> tuple[int, int]:
    found = board["rates"][name]
    found = found[by][value] if by else found
    return found["k"], found["n"]


def test_the_score_counts_what_the_answers_say() -> None:
    a, b = "gas_damping", "photothermal"
    rows = [
        answer("exact", [a], "explained", [a], found_shares={a: {"share": 0.95, "sd": 0.1}}),
        answer(
            "inexact", [a], "explained in part", [a], found_shares={a: {"share": 0.7, "sd": 0.1}}
        ),
        answer("inexact", [a], "explained in part", [a, b]),
        answer("exact", [a], "ambiguous", [b], alternatives=[[b], [a]]),
        answer("exact", [a], "ambiguous", [b], alternatives=[[b], [a, b]]),
        answer("exact", [a], "unexplained", []),
        answer("exact", [a], "none in time", []),
        answer("exact", [], "adequate", []),
        answer("glitches", [], "adequate", [], glitches=[50.0, 60.0], excluded=[{}, {}]),
        answer("glitches", [], "unexplained", [], glitches=[50.0, 60.0, 9.0], excluded=[{}]),
        answer("exact", [], "explained", [b]),
        answer("lacking", [a], "unexplained", []),
        answer("lacking", [a], "explained", [b]),
        answer("lacking", [a], "explained", [b], equals=[[a], [b]]),
        answer("exact", [a], "error", [], name="broken", error="ValueError()"),
    ]
    board = score(rows, {"seed": 1})
    assert rate(board, "named") == (3, 8)
    assert rate(board, "named", "by_regime", "inexact") == (1, 2)
    assert rate(board, "named alone") == (2, 8)
    assert rate(board, "wrong name") == (2, 8)
    assert rate(board, "false alarm") == (2, 4)
    assert rate(board, "named nothing") == (1, 4)
    assert rate(board, "lacking") == (2, 3)
    assert rate(board, "shares") == (1, 2)
    assert rate(board, "glitches") == (1, 2)
    assert rate(board, "in time") == (14, 15)
    assert board["failed"] == [["broken", "ValueError()"]]
    low, high = board["rates"]["lacking"]["interval"]
    # Clopper and Pearson: 2 of 3
    assert (low, high) == pytest.approx((0.0943, 0.9916), abs=1e-4)
    for by in ("regime", "kind"):
        assert len(table(board, by).splitlines()) == 2 + len(WORDS)
    columns = board["confusion"]["answers"]
    counts = np.array(board["confusion"]["draws"])
    row = dict(zip(board["confusion"]["hidden"], counts, strict=True))
    assert row[a][columns.index("tie without it")] == 1
    assert row[a][columns.index("no answer")] == 2
    assert row["none"][columns.index("adequate")] == 2


def test_todays_answers_without_shares_are_scored() -> None:
    board = score([answer("exact", ["gas_damping"], "explained", ["gas_damping"])], {"seed": 1})
    assert rate(board, "named") == (1, 1)
    assert rate(board, "shares") == (0, 0)


def test_a_faint_cause_may_be_missed_but_a_wrong_name_counts() -> None:
    faint = {"gas_damping": 3.5}
    rows = [
        answer("exact", ["gas_damping"], "adequate", [], sigma=faint),
        answer("exact", ["gas_damping"], "explained", ["photothermal"], sigma=faint),
    ]
    board = score(rows, {"seed": 1})
    assert rate(board, "named") == (0, 0)
    assert rate(board, "wrong name") == (1, 2)


def test_a_study_goes_on_with_its_seed_and_without_its_torn_line(tmp_path: Path) -> None:
    seed, records = known(tmp_path, 7)
    (tmp_path / "results.jsonl").write_text('{"name": "one"}\n{"name": "tw')
    assert known(tmp_path, None) == (seed, [{"name": "one"}])
    with pytest.raises(SystemExit, match="another folder"):
        known(tmp_path, 8)
    assert records == []


def test_a_file_of_a_round_is_written_diagnosed_and_kept_as_json(tmp_path: Path) -> None:
    draw = Draw("series", ("thermal_stress",), "exact", "square-270um", 3)
    kept = json.loads(json.dumps(jobs.run(0, draw, 60.0)))
    assert (kept["verdict"], kept["named"]) == ("explained", ["thermal_stress"])
    assert rate(score([kept], {"seed": 1}), "named") == (1, 1)
    make(draw, tmp_path / "file.nc")
    assert measurement.read(tmp_path / "file.nc").children.keys() == {"series"}
    assert KINDS.keys() >= set(jobs.KINDS)


def spend(seconds: float) -> None:
    start = time.process_time()
    while time.process_time() < start + seconds:
        pass


def test_what_takes_too_long_is_stopped_and_nothing_after_it() -> None:
    with pytest.raises(jobs.TooLongError), jobs.within(0.05):
        spend(10.0)
    spend(0.2)


def test_a_file_that_ends_in_an_error_counts_as_one_without_the_right_answer() -> None:
    draw = Draw("series", ("thermal_stress",), "exact", "square-270um", 3)
    record = jobs.about(0, draw) | {"verdict": "error", "seconds": 0.0, "error": "ValueError()"}
    assert rate(score([record], {"seed": 1}), "named") == (0, 1)


def test_a_stretched_film_loses_energy_as_one_that_is_not() -> None:
    rng = np.random.default_rng(1)
    bench = KINDS["spectrum"].setup("square-270um", ("clamp_loss",), rng)
    base = bench.draw(rng)
    parts = []
    for elongation in (0.0, 1e-2):
        _, loss, _ = bench._lines(base, {"aspect_ratio": {"elongation": elongation}})
        parts.append(loss)
    # The part of bending in the energy of the lowest mode changes as little as its wave vector
    assert parts[1][0] == pytest.approx(parts[0][0], rel=1e-2)
