"""Measurement files: read, checked, written and built; the contract between a lab and femnl."""

from typing import TYPE_CHECKING

from femnl.core.lazy import lazy_names

if TYPE_CHECKING:  # what a type checker reads; at run time the names load when they are first used
    from femnl.io.measurement.build import decay as decay
    from femnl.io.measurement.build import harmonic_map as harmonic_map
    from femnl.io.measurement.build import magnitudes_alone as magnitudes_alone
    from femnl.io.measurement.build import response as response
    from femnl.io.measurement.build import series as series
    from femnl.io.measurement.build import spectrum as spectrum
    from femnl.io.measurement.build import trace as trace
    from femnl.io.measurement.contract import CONTROLS as CONTROLS
    from femnl.io.measurement.contract import KINDS as KINDS
    from femnl.io.measurement.contract import VERSION as VERSION
    from femnl.io.measurement.control_variables import controls as controls
    from femnl.io.measurement.control_variables import varies as varies
    from femnl.io.measurement.files import bundle as bundle
    from femnl.io.measurement.files import read as read
    from femnl.io.measurement.files import write as write
    from femnl.io.measurement.hdf5_safety import open_hdf5 as open_hdf5
    from femnl.io.measurement.head import is_measurement as is_measurement
    from femnl.io.measurement.head import named_geometry as named_geometry
    from femnl.io.measurement.noise import amplitude as amplitude
    from femnl.io.measurement.noise import estimate_noise as estimate_noise
    from femnl.io.measurement.noise import noise_sd as noise_sd
    from femnl.io.measurement.sizes import need_room as need_room
    from femnl.io.measurement.sizes import need_room_for as need_room_for
    from femnl.io.measurement.units import coherent as coherent
    from femnl.io.measurement.units import quantity as quantity
    from femnl.io.measurement.units import to_si as to_si

# A unit or a file that is none is refused before arrays load
_NAMES = {
    "build": (
        "decay",
        "harmonic_map",
        "magnitudes_alone",
        "response",
        "series",
        "spectrum",
        "trace",
    ),
    "contract": ("CONTROLS", "KINDS", "VERSION"),
    "control_variables": ("controls", "varies"),
    "files": ("bundle", "read", "write"),
    "hdf5_safety": ("open_hdf5",),
    "head": ("is_measurement", "named_geometry"),
    "noise": ("amplitude", "estimate_noise", "noise_sd"),
    "sizes": ("need_room", "need_room_for"),
    "units": ("coherent", "quantity", "to_si"),
}
_HOMES = {name: f"femnl.io.measurement.{home}" for home, names in _NAMES.items() for name in names}
__all__ = [*_HOMES]
__getattr__ = lazy_names(__name__, _HOMES)


def __dir__() -> list[str]:
    return __all__
