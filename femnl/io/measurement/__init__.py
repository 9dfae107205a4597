"""Measurement files: read, checked, written and built; the contract between a lab and femnl."""

from femnl.io.measurement.build import (
    decay,
    harmonic_map,
    magnitudes_alone,
    response,
    series,
    spectrum,
    trace,
)
from femnl.io.measurement.contract import CONTROLS, KINDS, VERSION
from femnl.io.measurement.controls import controls, varies
from femnl.io.measurement.files import bundle, is_measurement, named_geometry, read, write
from femnl.io.measurement.hdf5_safety import open_hdf5
from femnl.io.measurement.noise import amplitude, estimate_noise, noise_sd
from femnl.io.measurement.sizes import need_room, need_room_for
from femnl.io.measurement.units import coherent, quantity, to_si

__all__ = [
    "CONTROLS",
    "KINDS",
    "VERSION",
    "amplitude",
    "bundle",
    "coherent",
    "controls",
    "decay",
    "estimate_noise",
    "harmonic_map",
    "is_measurement",
    "magnitudes_alone",
    "named_geometry",
    "need_room",
    "need_room_for",
    "noise_sd",
    "open_hdf5",
    "quantity",
    "read",
    "response",
    "series",
    "spectrum",
    "to_si",
    "trace",
    "varies",
    "write",
]
