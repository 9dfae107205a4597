"""Kinds of measurement: each package of femnl/observe states one, and a group is recognised."""

import numpy as np
import pytest
import xarray as xr

from femnl.core.errors import MeasurementError
from femnl.core.kinds import contracts, function, kind_of, kinds


def test_every_kind_states_its_stages_and_where_its_model_and_figure_are() -> None:
    assert set(kinds()) >= {"decay", "map", "record", "response", "series", "spectrum", "trace"}
    for spec in kinds().values():
        assert spec.stages
        assert callable(function(spec.pose))
        assert callable(function(spec.figure))


def test_a_special_case_has_no_contract_of_its_own() -> None:
    assert set(contracts()) == set(kinds()) - {"record"}


@pytest.mark.parametrize(("wavelength", "name"), [({}, "record"), ({"wavelength": 6e-7}, "trace")])
def test_a_trace_with_its_drive_and_no_wavelength_is_a_record(
    wavelength: dict[str, float], name: str
) -> None:
    group = xr.Dataset(
        {"drive_voltage": ("time", np.zeros(3))}, attrs={"kind": "trace", **wavelength}
    )
    assert kind_of(group).name == name


def test_a_kind_that_is_not_known_is_refused_with_those_that_are() -> None:
    with pytest.raises(MeasurementError, match=r"kind is 'smell'; known are decay, map, response"):
        kind_of(xr.Dataset(attrs={"kind": "smell"}))
