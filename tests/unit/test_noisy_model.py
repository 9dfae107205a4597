"""A model under the noise that was found: glitches left out, one factor, white residuals."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from femnl.core.checkpoint import open_checkpoint
from femnl.core.effect import Effect, ParameterSpec, Values
from femnl.core.readout import Array
from femnl.diagnose.candidate import Candidate
from femnl.diagnose.criticism import criticise
from femnl.diagnose.noise_of_file import last_noise
from femnl.fits.least_squares import fit
from femnl.observe.extended import ExtendedModel
from femnl.observe.noisy import FoundNoise, NoisyModel, with_noise
from femnl.observe.residuals import Layout
from tests.unit.level import Level

N = 60
BLOCKS = np.repeat(np.arange(6), N // 6)


class Line(Level):
    """Data along one line."""

    @property
    def layout(self) -> Layout:
        place = np.arange(N)
        before = place - 1
        after = np.where(place + 1 < N, place + 1, -1)
        none: NDArray[np.int64] = np.full(N, -1)
        return Layout(np.stack([before, after], axis=1), before, place, none)

    def describe(self, residuals: Array) -> str:
        return f"{len(residuals)} residuals, the largest of {np.abs(residuals).max():.3f}σ"


def line(data: Array) -> Line:
    return Line(data, BLOCKS, 1e4, {"slope": np.linspace(-1, 1, N)})


def noisy(data: Array, noise: FoundNoise) -> NoisyModel:
    model = with_noise(line(data), noise)
    assert isinstance(model, NoisyModel)
    return model


def noise(seed: int) -> Array:
    return np.random.default_rng(seed).standard_normal(N)


def test_noise_as_stated_changes_nothing() -> None:
    bare = line(noise(1))
    assert with_noise(bare, FoundNoise()) is bare


def test_data_without_neighbours_tell_their_noise_once_it_was_found_larger() -> None:
    bare = Level(noise(1), BLOCKS, 1e4)
    assert not bare.tells_noise
    assert not with_noise(bare, FoundNoise(glitches=(3,))).tells_noise
    assert with_noise(bare, FoundNoise(factor=1.5)).tells_noise


def test_a_model_without_neighbours_can_have_larger_noise() -> None:
    bare = Level(noise(1), BLOCKS, 1e4)
    larger = with_noise(bare, FoundNoise(factor=2.0))
    level = {"level": 0.5}
    stated = bare.residuals((), level, ())
    told = bare.blocks >= 0
    np.testing.assert_allclose(larger.residuals((), level, ())[told], stated[told] / 2)


def test_a_glitch_does_not_move_the_fit() -> None:
    data = 3 + noise(2)
    data[17] += 1e4
    clean = np.delete(data, 17)
    model = noisy(data, FoundNoise(glitches=(17,)))
    found = fit(ExtendedModel(model), model.start)
    assert found.vector[0] == pytest.approx(clean.mean(), abs=1e-4)
    assert found.residuals == pytest.approx(clean - clean.mean(), abs=1e-4)
    assert model.blocks.tolist() == np.delete(BLOCKS, 17).tolist()
    assert model.locate(17) == "datum 19"  # the one after the glitch
    assert model.describe(found.residuals).startswith(f"{N} residuals")
    assert model.layout.previous[17] == -1


def test_residuals_of_correlated_noise_become_white() -> None:
    # x_k = ρ x_{k−1} + √(1 − ρ²) w_k is undone exactly
    rho = 0.7
    drawn = noise(3)
    data = drawn.copy()
    for k in range(1, N):
        data[k] = rho * data[k - 1] + np.sqrt(1 - rho**2) * drawn[k]
    model = noisy(2.5 * data, FoundNoise(factor=2.5, correlation=rho))
    assert model.residuals((), {"level": 0.0}, ()) == pytest.approx(drawn, rel=1e-12)
    sizes, unit = model.quantity
    assert (sizes == 2.5).all()
    assert unit == "V"


def test_directions_are_whitened_like_residuals() -> None:
    model = noisy(noise(4), FoundNoise(factor=2.0, correlation=0.5))
    (direction,) = model.residual_directions((), {"level": 0.0}, ()).values()
    step = model.residuals((), {"level": 0.0}, ()) - model.residuals((), {"level": 1.0}, ())
    assert direction == pytest.approx(model.white(np.linspace(-1, 1, N)))
    assert step == pytest.approx(model.white(np.ones(N)))


def test_a_fit_under_one_noise_is_not_recalled_under_another(tmp_path: Path) -> None:
    data = 3 + noise(4)
    data[17] += 1e3
    kept = open_checkpoint(tmp_path / "fits.jsonl")
    whole = line(data)
    with_glitch = fit(ExtendedModel(whole), whole.start, checkpoint=kept)
    model = noisy(data, FoundNoise(glitches=(17,)))
    without = fit(ExtendedModel(model), model.start, checkpoint=kept)
    mean = np.delete(data, 17).mean()
    assert with_glitch.vector == pytest.approx(data.mean(), rel=1e-6)
    assert without.vector == pytest.approx(mean, rel=1e-6)


def test_a_fit_of_other_data_from_the_same_start_is_not_recalled(tmp_path: Path) -> None:
    kept = open_checkpoint(tmp_path / "fits.jsonl")
    for level in (3.0, 4.0):
        model = line(level + noise(4))
        found = fit(ExtendedModel(model), model.start, checkpoint=kept)
        assert found.vector == pytest.approx(level + noise(4).mean(), rel=1e-6)


def remaining(left: Array, *, causes: int = 1) -> Candidate:
    """Return causes of strong signal, fitted to data that they leave so much of."""
    signal = 1e3 * np.linspace(-1, 1, N)
    names = ("slope", "bend")[:causes]
    bare = Level(signal + left, BLOCKS, 1e4)
    found = fit(ExtendedModel(bare, tuple(linear(name) for name in names)), START[: 1 + causes])
    return criticise(found, [])


START = np.array([0.0, 1.0, 1.0])


def linear(name: str) -> Effect:
    """Return an effect that adds a line, or a parabola, times its strength."""
    shape = np.linspace(-1, 1, N) ** (1 if name == "slope" else 2)

    def act(value: Array, values: Values) -> Array:
        return value + values["strength"] * shape

    spec = ParameterSpec("strength", "1", -1e4, 1e4)
    return Effect(name, "", (spec,), {"placement": act}, "", "", "")


def test_what_one_cause_leaves_counts_as_larger_noise_where_it_looks_like_it() -> None:
    seen = last_noise(remaining(2 * noise(5)), {})
    assert seen[""].factor == pytest.approx(2.0, rel=0.2)
    assert last_noise(remaining(noise(5)), {}) == {}
    assert last_noise(remaining(4 * noise(5)), {}) == {}, "too much for a wrong statement"
    wave = 3 * np.sin(np.linspace(0, 4 * np.pi, N))
    assert last_noise(remaining(noise(5) + wave), {}) == {}, "neighbours deviate together"
    assert last_noise(remaining(2 * noise(5), causes=2), {}) == {}
