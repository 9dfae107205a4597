"""Results on disk: NetCDF that femnl reads, VTU for other programs, and a cache of modes."""

from femnl.io.results.atomic import make_folder, need_room, write_whole
from femnl.io.results.cache import cached_modes, cached_nonlinearity
from femnl.io.results.netcdf import read_modes, write_modes
from femnl.io.results.surface import unfold
from femnl.io.results.vtu import check_suffix, write_mesh, write_vtu

__all__ = [
    "cached_modes",
    "cached_nonlinearity",
    "check_suffix",
    "make_folder",
    "need_room",
    "read_modes",
    "unfold",
    "write_mesh",
    "write_modes",
    "write_vtu",
    "write_whole",
]
