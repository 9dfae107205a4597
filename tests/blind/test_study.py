"""The blind study's bookkeeping.

It resumes, its draws are fair, and its scores are what the records say.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.special import expit, logit

from femnl.core.fit import Parameter
from tests.blind.jobs import IMPOSSIBLE, jobs, pulls_of, run
from tests.blind.lab import GEOMETRIES, KINDS, Case, causes
from tests.blind.scoreboard import WORDS, score, table
from tests.blind.study import plan


def record(
    task: str, hidden: list[str], verdict: str, named: list[str], **more: Any
) -> dict[str, Any]:
    """A result as the study writes it."""
    about = {
        "name": f"{task} {len(more)} {verdict}",
        "file": "one",
        "kind": "series",
        "geometry": "square-270um",
        "p_value": 0.5,
        "gain": 2.0,
    }
    answer = {
        "sigma": dict.fromkeys(hidden, 20.0),
        "truth": {name: {"x": 1.0} for name in hidden},
        "best_gain": None,
        "alternatives": [],
        "trials": [],
    }
    return (
        about
        | answer
        | {
            "task": task,
            "causes": hidden,
            "verdict": verdict,
            "named": named,
            "pulls": {},
            "seconds": 1.0,
        }
        | more
    )


def test_every_round_hides_every_cause_alone_weakened_and_removed() -> None:
    draws = jobs(seed=1, rounds=3)
    for task in ("hidden", "weakened", "removed"):
        found = {(job.case.kind, *job.case.causes) for job in draws if job.task == task}
        assert found >= {
            (kind, cause)
            for kind in KINDS
            for cause in causes(kind)
            if any((cause, geometry) not in IMPOSSIBLE for geometry in GEOMETRIES[kind])
        }
    assert len({job.name for job in draws}) == len(draws)


def test_a_removed_cause_is_in_the_very_file_of_the_hidden_one() -> None:
    draws = jobs(seed=1, rounds=2)
    assert {j.file for j in draws if j.task == "removed"} == {
        j.file for j in draws if j.task == "hidden"
    }


def test_a_study_that_was_killed_goes_on_with_its_seed_and_without_its_torn_line(
    tmp_path: Path,
) -> None:
    seed, todo, results = plan(tmp_path, 1, None, ("series",))
    results.write_text(json.dumps({"name": todo[0].name}) + "\n" + '{"name": "' + todo[1].name)
    again, left, _ = plan(tmp_path, 1, None, ("series",))
    assert again == seed
    assert [job.name for job in left] == [job.name for job in todo[1:]]
    assert results.read_text() == json.dumps({"name": todo[0].name}) + "\n"


def test_the_scoreboard_counts_what_the_records_say() -> None:
    rows = [
        record("null", [], "adequate", []),
        record("null", [], "explained", ["gas_damping"]),
        record(
            "hidden",
            ["gas_damping"],
            "explained",
            ["gas_damping"],
            pulls={"gas_damping.x": 0.5},
            best_gain=2.0,
        ),
        record("hidden", ["gas_damping"], "explained", ["photothermal"]),
        record(
            "hidden",
            ["gas_damping"],
            "ambiguous",
            ["photothermal"],
            alternatives=[[["gas_damping"], 0.4]],
            file="two",
        ),
        record("removed", ["gas_damping"], "explained", ["photothermal"], file="two"),
        record("removed", ["gas_damping"], "unexplained", [], file="three"),
    ]
    rates = score(rows, [1])["rates"]
    assert (rates["false alarms"]["k"], rates["false alarms"]["n"]) == (1, 2)
    assert (rates["cause named"]["k"], rates["cause named"]["n"]) == (2, 3)
    assert (rates["wrong cause explained"]["k"], rates["wrong cause explained"]["n"]) == (1, 5)
    assert (rates["removed cause unexplained"]["k"], rates["removed cause unexplained"]["n"]) == (
        2,
        2,
    )
    assert (rates["68 % intervals hold"]["k"], rates["gain within 10 % of the best"]["k"]) == (1, 1)


def test_causes_named_in_part_count_as_named() -> None:
    part = "explained in part"
    rows = [
        record("null", [], "adequate", []),
        record("hidden", ["gas_damping"], part, ["gas_damping"]),
        record("hidden", ["gas_damping"], part, ["photothermal"], file="two"),
        record("removed", ["gas_damping"], part, ["photothermal"], file="three"),
    ]
    board = score(rows, [1])
    counts = {name: (rate["k"], rate["n"]) for name, rate in board["rates"].items()}
    assert counts["cause named"] == (1, 2)
    assert counts["cause named alone"] == (1, 2)
    assert counts["wrong cause explained"] == (2, 3)
    assert counts["removed cause unexplained"] == (0, 1)
    answers = board["confusion"]["answers"]
    row = board["confusion"]["draws"][board["confusion"]["hidden"].index("gas_damping")]
    assert row[answers.index("gas_damping")] == row[answers.index("photothermal")] == 1


def test_an_answer_nearly_as_good_as_the_lacking_cause_is_counted_apart() -> None:
    rows = []
    for file, left, verdict, named in (
        ("near", 120.0, "explained", ["photothermal"]),
        ("far", 130.0, "explained", ["photothermal"]),
        ("faint", 124.0, "adequate", []),
    ):
        trials = [[[], 124.0 if file == "faint" else 500.0], [["gas_damping"], 100.0]]
        rows.append(
            record(
                "hidden", ["gas_damping"], "explained", ["gas_damping"], file=file, trials=trials
            )
        )
        rows.append(
            record("removed", ["gas_damping"], verdict, named, file=file, trials=[[named, left]])
        )
    rates = score(rows, [1])["rates"]
    assert rates["removed cause unexplained"]["k"] == 0
    assert rates["removed cause unexplained, or told by another within 5σ"]["k"] == 2
    assert rates["wrong cause explained"]["k"] == 2
    assert rates["wrong cause explained, 5σ worse than the truth"]["k"] == 1


def test_the_table_has_every_rate_by_kind() -> None:
    rows = [
        record(task, ["gas_damping"], "explained", ["gas_damping"])
        for task in ("hidden", "pair", "removed")
    ]
    rows[0] |= {"pulls": {"gas_damping.x": 0.5}, "best_gain": 2.0}
    lines = table(score([*rows, record("null", [], "adequate", [])], [1])).splitlines()
    assert len(lines) == 2 + len(WORDS) + 1
    assert lines[3] == "| cause named, alone or among equals | 1 of 1 | 2.5 … 100.0 % | 1 of 1 |"


def test_the_limit_of_detection_is_where_95_percent_are_named() -> None:
    rng = np.random.default_rng(7)
    size = np.exp(rng.uniform(np.log(0.7), np.log(300), 4000))
    named = rng.random(4000) < 0.99 * expit(4 * np.log(size / 4))

    def limit(draws: list[tuple[float, bool]]) -> float | None:
        rows = [
            record(
                "hidden",
                ["x"],
                "explained" if hit else "adequate",
                ["x"] if hit else [],
                sigma={"x": s},
                truth={"x": {"force": 3 * s}},
            )
            for s, hit in draws
        ]
        found = score([*rows, record("null", [], "adequate", [])], [1])["limits"].get("series: x")
        assert found is None or found["force"] == pytest.approx(3 * found["sigma"])
        return float(found["sigma"]) if found else None

    assert limit([*zip(size, named, strict=True)]) == pytest.approx(
        4 * np.exp(logit(0.95 / 0.99) / 4), rel=0.1
    )
    few = [(float(s), bool(s > 4)) for s in np.geomspace(0.7, 300, 24)]
    alone = limit(few)
    lost = limit([*few, (280.0, False)])
    assert alone is not None
    assert lost is not None
    assert lost < 1.5 * alone
    assert limit([(s, s != 500) for s in np.linspace(250, 750, 25)]) is None, (
        "no draw was weak enough to tell"
    )


def test_p_values_are_held_to_be_uniform_kind_by_kind() -> None:
    # Small ones of one kind and large ones of another are uniform together.
    rows = [
        record("null", [], "adequate", []) | {"kind": kind, "p_value": (n + half) / 100}
        for kind, half in (("map", 0), ("trace", 50))
        for n in range(50)
    ]
    found = score(rows, [1])["p_value_uniform"]
    assert found["ks_p_value"] > 0.9
    assert all(found["by_kind"][kind]["ks_p_value"] < 1e-6 for kind in ("map", "trace"))


def test_a_cause_that_does_not_stand_out_may_be_left_unnamed_but_no_other() -> None:
    faint = {"gas_damping": 20.0, "photothermal": 3.0}
    rows = [
        record(
            "pair",
            ["gas_damping", "photothermal"],
            "explained",
            ["gas_damping"],
            sigma=faint,
            file="one",
        ),
        record(
            "pair",
            ["gas_damping", "photothermal"],
            "explained",
            ["photothermal"],
            sigma=faint,
            file="two",
        ),
        record(
            "pair",
            ["gas_damping", "photothermal"],
            "explained",
            ["gas_damping", "gas_loading"],
            sigma=faint,
            file="three",
        ),
    ]
    rates = score(rows, [1])["rates"]
    assert (rates["wrong cause explained"]["k"], rates["wrong cause explained"]["n"]) == (2, 3)


def test_a_draw_gives_a_line_that_json_takes() -> None:
    (job,) = [
        j
        for j in jobs(seed=3, rounds=1, kinds=("series",))
        if j.task == "hidden" and j.case.causes == ("gas_damping",)
    ]
    kept = json.loads(json.dumps(run(job)))
    assert kept["named"] == ["gas_damping"]
    assert kept["best_gain"] == pytest.approx(kept["gain"], rel=0.05)


@pytest.mark.parametrize(
    ("kind", "cause", "name", "turned"),
    [
        ("spectrum", "clamp_loss", "dipole", True),
        ("spectrum", "stress_anisotropy", "anisotropy", False),
        ("holes", "stress_anisotropy", "anisotropy", True),
        ("response", "quadratic_stiffness", "kappa2", True),
        ("record", "quadratic_stiffness", "kappa2", False),
    ],
)
def test_a_mirror_image_holds_the_truth_where_data_tell_no_sign(
    kind: str, cause: str, name: str, turned: bool
) -> None:
    base = dict.fromkeys(("speed", "frequency", "linewidth", "stiffness", "alpha"), 1.0)
    truth = {"base": base, "causes": {cause: {name: 0.2}}}
    found = {cause: {name: Parameter(name, -0.21, 0.01, "1")}}
    (pull,) = pulls_of(Case(kind, (cause,), 1), truth, found).values()
    assert pull == pytest.approx(1.0 if turned else -41.0)


def test_the_speed_beside_a_clamp_that_gives_way_is_not_compared() -> None:
    truth = {"base": {"speed": 600.0}, "causes": {"compliant_clamp": {"depth_cubed": 1e-17}}}
    found = {
        "base": {"speed": Parameter("speed", 590.0, 0.1, "m/s")},
        "compliant_clamp": {"depth_cubed": Parameter("depth_cubed", 1.2e-17, 1e-18, "m^3")},
    }
    pulls = pulls_of(Case("spectrum", ("compliant_clamp",), 1), truth, found)
    assert pulls == {"compliant_clamp.depth_cubed": pytest.approx(2.0)}
