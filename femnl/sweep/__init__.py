"""Design sweeps: many devices that differ in a few values of their geometry file."""

from femnl.sweep.collect import collect, write_tables
from femnl.sweep.run import Report, costs, engine, need_room_for, run
from femnl.sweep.spec import Sweep, read_sweep
from femnl.sweep.store import Store, open_store

__all__ = [
    "Report",
    "Store",
    "Sweep",
    "collect",
    "costs",
    "engine",
    "need_room_for",
    "open_store",
    "read_sweep",
    "run",
    "write_tables",
]
