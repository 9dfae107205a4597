"""The open example measurements, each with one hidden cause or none: the verdict names it and its parameters hold the truth."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from femnl.diagnose import diagnose

DATA = Path(__file__).parents[3] / "shared" / "data"
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not DATA.is_dir(), reason="the shared example measurements are not beside the repository"),
]
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
    for parameter, value in _expected(name, truth["parameters"]).items():
        p = own.get(parameter) or found.parameters["base"][parameter]
        assert abs(abs(p.value) - abs(value)) < 4 * p.sd, parameter
    if truth["cause"]:
        assert found.gain > 2


def _expected(name: str, truth: dict[str, Any]) -> dict[str, float]:
    """The truth in the names and units of the diagnosis; places on a square film up to its symmetry, by their sign alone."""
    if name == "open-spectrum-mass":
        return {"mass": truth["mass_kg"]}
    if name == "open-spectrum-drift":
        return {"rate": truth["rate_per_s"]}
    if name == "open-map-tilt":
        slope = np.array(truth["gradient_rad_per_m"]) * 632.8e-9 / (4 * np.pi)
        return {"amplitude": truth["U"], "slope_x": slope[0], "slope_y": slope[1]}
    names = {"U": "amplitude", "theta": "theta", "gap": "gap", "eta": "eta"}
    return {names[key]: value for key, value in truth.items() if key in names}
