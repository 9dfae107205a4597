"""Design sweeps: many devices that differ in a few values of their geometry file."""

from typing import TYPE_CHECKING

from femnl.core.lazy import lazy_names

if TYPE_CHECKING:  # what a type checker reads; at run time the names load when they are first used
    from femnl.sweep.runner import Report as Report
    from femnl.sweep.runner import costs as costs
    from femnl.sweep.runner import engine as engine
    from femnl.sweep.runner import need_room_for as need_room_for
    from femnl.sweep.runner import run as run
    from femnl.sweep.spec import Sweep as Sweep
    from femnl.sweep.spec import read_sweep as read_sweep
    from femnl.sweep.store import Store as Store
    from femnl.sweep.store import open_store as open_store
    from femnl.sweep.tables import collect as collect
    from femnl.sweep.tables import write_tables as write_tables

# A sweep file that cannot be meant is refused before meshers and solvers load
_HOMES = {
    "Report": "femnl.sweep.runner",
    "Store": "femnl.sweep.store",
    "Sweep": "femnl.sweep.spec",
    "collect": "femnl.sweep.tables",
    "costs": "femnl.sweep.runner",
    "engine": "femnl.sweep.runner",
    "need_room_for": "femnl.sweep.runner",
    "open_store": "femnl.sweep.store",
    "read_sweep": "femnl.sweep.spec",
    "run": "femnl.sweep.runner",
    "write_tables": "femnl.sweep.tables",
}
__all__ = [*_HOMES]
__getattr__ = lazy_names(__name__, _HOMES)


def __dir__() -> list[str]:
    return __all__
