"""The study of odd devices: its events, and one device whose clamp yields."""

from tests.blind.odd_devices import make, score


def record(
    cause: str, named: dict[str, str], words: str = "", out: float = 10.0
) -> dict[str, object]:
    return {"cause": cause, "named": named, "words": words, "stands_out": out}


def test_the_score_counts_what_the_fits_say() -> None:
    rates = score(
        [
            record("added_mass", {"odd": "added_mass"}),
            record("aspect_ratio", {"odd": "stress_anisotropy"}, "aspect_ratio may do the same"),
            record("shear_stress", {"odd": "tension_gradient"}),
            record("shear_stress", {}, out=2.0),
            record("other stress", {"odd": "other film or shape"}),
            record("other stress", {"odd": "compliant_clamp", "D3": "lossy"}),
        ]
    )
    counted = {name: (found["k"], found["n"]) for name, found in rates.items()}
    assert counted == {
        "odd device named": (5, 5),
        "an ordinary device named": (1, 6),
        "cause named, or among its equals": (2, 3),
        "wrong cause named": (1, 4),
        "other stress given no cause": (1, 2),
    }


def test_a_chip_hides_what_its_seed_says() -> None:
    chip, truth = make(574671950)
    again, _ = make(574671950)
    assert [m.frequency for m in chip.members] == [m.frequency for m in again.members]
    assert truth["cause"] == "compliant_clamp"
    assert truth["stands_out"] > 6
    assert len(chip.members) == 13
