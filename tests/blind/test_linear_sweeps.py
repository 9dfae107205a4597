"""The study of linear sweeps: its events, and what a seed draws."""

import numpy as np

from tests.blind.linear_sweeps import LEAK, make, score


def record(cause: str, verdict: str, *named: list[str], sweeps: int = 2) -> dict[str, object]:
    return {"cause": cause, "verdict": verdict, "named": list(named), "sweeps": sweeps}


def test_the_score_counts_what_the_diagnoses_say() -> None:
    rates = score(
        [
            record("", "adequate"),
            record("", "explained", ["quadratic_stiffness"], sweeps=1),
            record(LEAK, "explained", [LEAK]),
            record(LEAK, "ambiguous", [LEAK], ["sloping_background"]),
            record(LEAK, "explained", ["sloping_background"]),
            record(LEAK, "unexplained"),
        ]
    )
    counted = {name: (found["k"], found["n"]) for name, found in rates.items()}
    assert counted == {
        "nothing hidden: adequate": (1, 2),
        "leak named, or among its equals": (2, 4),
        "wrong cause named": (1, 4),
    }
    assert rates["nothing hidden: adequate"]["by_kind"]["one sweep"]["k"] == 0


def test_a_seed_draws_a_linear_mode_and_its_leak() -> None:
    seeds = range(20)
    drawn = [make(seed) for seed in seeds]
    assert {truth["cause"] for _, truth in drawn} == {"", LEAK}
    for sweeps, truth in drawn:
        by_drive = (sweeps["real"] + 1j * sweeps["imag"]).values / sweeps["drive"].values[:, None]
        apart = np.abs(by_drive - by_drive[-1]) * sweeps["drive"].values[:, None]
        assert np.median(apart) < 5 * sweeps.attrs["noise_sd"]
        assert sweeps.sizes["sweep"] == truth["sweeps"]
    again, _ = make(3)
    np.testing.assert_array_equal(again["real"], drawn[3][0]["real"])
