"""Results on disk: NetCDF that femnl reads, VTU for other programs, and a cache of modes."""
