"""The open example measurements, each with one hidden cause or none: the verdict names it and its parameters hold the truth."""

import json
from pathlib import Path

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
    if name == "open-map-tilt":
        amplitude = found.parameters["base"]["amplitude"]
        assert abs(amplitude.value - truth["parameters"]["U"]) < 4 * amplitude.sd
    if name == "open-spectrum-drift":
        rate = found.parameters["frequency_drift"]["rate"]
        assert abs(rate.value - truth["parameters"]["rate_per_s"]) < 4 * rate.sd
        assert np.isfinite(found.gain)
