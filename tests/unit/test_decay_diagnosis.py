"""Decays from the file to the verdict: causes named with their numbers, and none without one."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from femnl import measurement
from femnl.core.diagnosis import Diagnosis
from femnl.diagnose import diagnose, record
from femnl.effects import library
from tests.unit.decay_records import QUALITY, RATE, TONE
from tests.unit.decay_records import record as recorded

Complex = NDArray[np.complex128]
REAL = Path(__file__).parents[3] / "shared" / "data" / "decays"
AFTER = recorded(0)[0][100:] - recorded(0)[0][100]
"""Times [s] from the switch-off in a record of 600 points."""
PLAIN = np.exp(-RATE * AFTER / 2).astype(complex)


def told(
    folder: Path,
    seed: int,
    envelope: Complex | None = None,
    *,
    lacking: str = "",
    from_begin: bool = False,
) -> Diagnosis:
    """Diagnose a simulated record.

    Args: lacking: effect that is taken out of the library; from_begin: whether the record begins
    with the decay, so that no corner of the drive is cut off.
    """
    time, power, begin = recorded(seed, envelope, floor=1e-5)
    part = slice(begin if from_begin else 0, None)
    groups = {"decay": measurement.decay(time[part], power[part], attributes={"frequency": TONE})}
    measurement.write(measurement.bundle(groups), folder / "a.nc")
    effects = [effect for name, effect in library().items() if name != lacking]
    return diagnose(folder / "a.nc", effects=effects)


def pull(found: Diagnosis, owner: str, name: str, truth: float) -> float:
    """Return how many standard deviations a parameter is off."""
    parameter = found.parameters[owner][name]
    return (parameter.value - truth) / parameter.sd


@pytest.mark.parametrize(
    "seed", [21, 22, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (23, 24))]
)
def test_one_mode_is_adequate_and_has_its_rate(seed: int, tmp_path: Path) -> None:
    found = told(tmp_path, seed)
    assert (found.verdict, found.causes) == ("adequate", ()), found.where
    assert abs(pull(found, "base", "decay_rate", 2 * np.pi * TONE / QUALITY)) < 4


def test_nonlinear_damping_is_named_with_the_rate_of_small_motion(tmp_path: Path) -> None:
    bent = PLAIN / np.sqrt(1 - 2 * np.expm1(-RATE * AFTER))
    found = told(tmp_path, 5, bent, from_begin=True)
    assert (found.verdict, found.causes) == ("explained", ("nonlinear_damping",)), found.where
    assert abs(pull(found, "base", "decay_rate", RATE)) < 4
    assert found.shares[0].share > 0.95
    eta = found.parameters["nonlinear_damping"]["eta"]
    assert eta.unit == "A0^-2"
    # ηA0²/4 = 2
    assert abs(eta.value - 8) < 4 * eta.sd


def test_a_pair_is_named_with_its_splitting_and_both_rates(tmp_path: Path) -> None:
    splitting = 1.7 * RATE / np.pi
    weaker = 0.4 * np.exp(-0.1 * RATE * AFTER + 2j * np.pi * splitting * AFTER)
    found = told(tmp_path, 5, PLAIN * (1 + weaker))
    assert (found.verdict, found.causes) == ("explained", ("beating_pair",)), found.where
    assert abs(pull(found, "beating_pair", "splitting", splitting)) < 4
    assert abs(pull(found, "beating_pair", "partner_rate", 1.2 * RATE)) < 4
    assert found.parameters["beating_pair"]["partner_rate"].sd < 0.1 * RATE


def test_a_leak_of_the_drive_is_named_with_its_size(tmp_path: Path) -> None:
    offset = 2 / AFTER[-1]
    leak = 0.05 * np.exp(2j * np.pi * offset * AFTER + 1j)
    found = told(tmp_path, 5, PLAIN + leak)
    assert (found.verdict, found.causes) == ("explained", ("feed_through",)), found.where
    assert abs(pull(found, "feed_through", "offset", offset)) < 4
    parts = [found.parameters["feed_through"][name].value for name in ("in_phase", "quadrature")]
    # In units of the amplitude where the comparison begins, 2 % of the decay after the switch-off
    assert np.linalg.norm(parts) == pytest.approx(0.053, rel=0.1)


@pytest.mark.parametrize("periods", [4, 6.5])
def test_beats_as_long_as_the_decay_are_a_leak_of_the_drive(periods: float, tmp_path: Path) -> None:
    """No piece of such a record is the decay, and its noise is not that of the leak."""
    offset = periods / AFTER[-1]
    found = told(tmp_path, 5, PLAIN + 0.15 * np.exp(2j * np.pi * offset * AFTER + 2j))
    assert (found.verdict, found.causes) == ("explained", ("feed_through",)), found.where
    assert found.p_value < 1e-300
    assert 0.7 < found.after.chi2_reduced < 1.3
    assert abs(pull(found, "feed_through", "offset", offset)) < 4
    assert abs(pull(found, "base", "decay_rate", RATE)) < 4


def test_a_frequency_that_leaves_the_filter_is_named(tmp_path: Path) -> None:
    pace = (2.5 / AFTER[-1]) ** 2
    found = told(tmp_path, 6, PLAIN * np.exp(-0.5 * pace * AFTER**2))
    assert found.causes == ("filter_exit",), found.where
    assert found.parameters["filter_exit"]["exit_rate"].value == pytest.approx(pace, rel=0.2)


def test_an_exchange_of_energy_is_named_with_both_rates(tmp_path: Path) -> None:
    corner = 1 / RATE
    late = np.exp(-1.5 - RATE * (AFTER - corner) / 2)
    found = told(tmp_path, 5, np.where(corner > AFTER, np.exp(-1.5 * RATE * AFTER), late) + 0j)
    assert (found.verdict, found.causes) == ("explained", ("energy_exchange",)), found.where
    assert abs(pull(found, "energy_exchange", "excess", 2.0)) < 4
    assert abs(pull(found, "base", "decay_rate", RATE)) < 4


@pytest.mark.slow
def test_without_its_effect_a_cause_is_unexplained_and_described(tmp_path: Path) -> None:
    splitting = 1.7 * RATE / np.pi
    weaker = 0.4 * np.exp(-0.1 * RATE * AFTER + 2j * np.pi * splitting * AFTER)
    found = told(tmp_path, 5, PLAIN * (1 + weaker), lacking="beating_pair")
    assert (found.verdict, found.causes) == ("unexplained", ()), found.where
    assert found.where.startswith("the decay is not that of one mode")
    assert {form.sentence for form in found.free_forms} >= {
        "a damping that varies with amplitude",
        "a gain that varies smoothly with time",
    }


def test_dropouts_are_listed_and_change_nothing(tmp_path: Path) -> None:
    time, power, begin = recorded(31, floor=1e-5)
    power[begin + 60 : begin + 75] -= 30
    power[begin + 150] += 4
    groups = {"decay": measurement.decay(time, power)}
    measurement.write(measurement.bundle(groups), tmp_path / "a.nc")
    found = diagnose(tmp_path / "a.nc")
    assert found.verdict == "adequate", found.where
    listed = record(found)["excluded"]
    assert [one["where"].split()[0] for one in listed] == ["power,", "power"]
    assert all(one["sigma"] > 10 for one in listed)


def test_what_a_cause_changes_is_told_in_decibels_and_adds_up(tmp_path: Path) -> None:
    bent = PLAIN / np.sqrt(1 - 2 * np.expm1(-RATE * AFTER))
    found = told(tmp_path, 5, bent, from_begin=True)
    assert found.contributions is not None
    (account,) = found.contributions.accounts
    assert (account.quantity, account.unit) == ("power", "dB")
    (cause,) = account.causes
    total = cause.values + account.interaction.values + account.remainder.values
    np.testing.assert_allclose(total, account.deviation.values, atol=1e-9)
    # 10 lg(1 + d(1 − e^{−γt})) dB go to nonlinear damping, until the noise is all that is seen
    time = np.asarray(account.coordinates["time"][0], float)
    strong = time < time[0] + 4 / RATE
    late = time[strong] - time[0]
    expected = -10 * np.log10(1 - 2 * np.expm1(-RATE * late))
    np.testing.assert_allclose(cause.values[strong], expected, atol=0.5)


def test_a_file_of_two_decays_is_diagnosed_jointly(tmp_path: Path) -> None:
    groups = {}
    for k in range(2):
        time, power, _ = recorded(41 + k, floor=1e-5)
        groups[f"decay{k}"] = measurement.decay(time, power)
    measurement.write(measurement.bundle(groups), tmp_path / "a.nc")
    found = diagnose(tmp_path / "a.nc", effects=[])
    assert found.verdict == "adequate", found.where
    assert {"decay0.decay_rate", "decay1.decay_rate"} <= set(found.parameters["base"])


@pytest.mark.shared
@pytest.mark.skipif(not REAL.is_dir(), reason="the shared ring-downs are not beside the repository")
@pytest.mark.parametrize(("number", "cause"), [(3326, "beating_pair")])
def test_real_beats_of_a_sixth_of_a_decibel_are_a_pair(
    number: int, cause: str, tmp_path: Path
) -> None:
    from femnl.io.labfiles import import_file

    (path,) = REAL.glob(f"measID_{number}_*.txt")
    import_file(path, tmp_path / "a.nc")
    assert diagnose(tmp_path / "a.nc").causes == (cause,)


def test_a_phase_that_is_off_is_told_as_a_phase(tmp_path: Path) -> None:
    """The frequency follows the amplitude, the power falls as that of one mode."""
    rng = np.random.default_rng(31)
    time = np.linspace(0, 1, 800)
    decay = np.exp(-6 * time)
    volts = decay * np.exp(1j * (0.4 + 8 * (1 - decay**2)))
    volts = volts + 1e-4 * (rng.standard_normal((800, 2)) @ [1, 1j])
    group = measurement.decay(
        time, real=volts.real, imag=volts.imag, attributes={"frequency": TONE}
    )
    measurement.write(measurement.bundle({"decay": group}), tmp_path / "a.nc")
    found = diagnose(tmp_path / "a.nc", effects=[])
    assert "the phase is off by up to" in found.where
    assert "rad, and the residuals" in found.where
