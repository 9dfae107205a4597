"""The open example measurements, each with one hidden cause or none.

The verdict names it and its parameters hold the truth.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from femnl.core.fit import Parameter
from femnl.diagnose import diagnose

DATA = Path(__file__).parents[3] / "shared" / "data"
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        not DATA.is_dir(), reason="the shared example measurements are not beside the repository"
    ),
]
SIDE = 270e-6
NEAR = 4.0
"""Standard deviations within which the truth must lie, for a dozen numbers."""
CAUSES = {
    "open-spectrum-null": [],
    "open-spectrum-mass": ["added_mass"],
    "open-spectrum-drift": ["frequency_drift"],
    "open-map-null": [],
    "open-map-multilayer": ["multilayer_fringe"],
    "open-map-tilt": ["phase_tilt"],
    "open-response-null": [],
    "open-response-damping": ["nonlinear_damping"],
}


@pytest.mark.parametrize("name", CAUSES)
def test_the_hidden_cause_of_an_open_file_is_named_and_none_where_none_is_hidden(name: str) -> None:
    truth = json.loads((DATA / "open-truth.json").read_text(encoding="utf-8"))[name]
    found = diagnose(DATA / f"{name}.nc")
    assert [truth["cause"]] * bool(truth["cause"]) == CAUSES[name]
    assert list(found.causes) == CAUSES[name]
    assert found.verdict == ("explained" if CAUSES[name] else "adequate")
    own = found.parameters.get(truth["cause"], {})
    expected = _expected(name, truth["parameters"])
    for parameter, value in expected.items():
        p = own.get(parameter) or found.parameters["base"][parameter]
        # With its sign: the drive of these files is in phase with the motion, which is where a
        # diagnosis gives it.
        assert abs(p.value - value) < NEAR * p.sd, (parameter, p, value)
    if name == "open-spectrum-mass":
        _assert_on_an_image_of(own["x"], own["y"], truth["parameters"])
    if truth["cause"]:
        assert found.gain > 2


def _assert_on_an_image_of(x: Parameter, y: Parameter, truth: dict[str, float]) -> None:
    """Return whether the particle is where it was put, or at an image of that place.

    The file counts from a corner; the square has eight symmetries.
    """
    there = [truth[axis] - SIDE / 2 for axis in ("x", "y")]
    images = [(sx * a, sy * b) for a, b in (there, there[::-1]) for sx in (1, -1) for sy in (1, -1)]
    near = min(max(abs(x.value - a) / x.sd, abs(y.value - b) / y.sd) for a, b in images)
    assert near < NEAR, (x, y, there)


def _expected(name: str, truth: dict[str, Any]) -> dict[str, float]:
    """The truth in the names and units of the diagnosis."""
    if name == "open-spectrum-mass":
        return {"mass": truth["mass_kg"]}
    if name == "open-spectrum-drift":
        return {"rate": truth["rate_per_s"]}
    if name == "open-map-tilt":
        slope = np.array(truth["gradient_rad_per_m"]) * 632.8e-9 / (4 * np.pi)
        return {"amplitude": truth["U"], "slope_x": slope[0], "slope_y": slope[1]}
    names = {"U": "amplitude", "theta": "theta", "gap": "gap", "eta": "eta"}
    return {names[key]: value for key, value in truth.items() if key in names}
