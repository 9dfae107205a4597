"""Running a sweep: what is missing in its store is solved and kept, point by point."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

from femnl.core.memory import need_memory
from femnl.core.processes import dask
from femnl.sweep.cluster import on_cluster
from femnl.sweep.point import Point, Record, Settings
from femnl.sweep.processes import on_processes
from femnl.sweep.spec import Sweep
from femnl.sweep.store import Store

PILOTS = 3
"""Points, spread over the sweep, from which its cost is estimated."""
Engine = Callable[[Iterator[Point], Settings], Iterator[Record]]


@dataclass(frozen=True)
class Report:
    """How far a sweep is. points: different ones that it asks for.

    failed: how many of them, by reason.

    seconds: mean of a point; memory: of the largest worker [bytes]; size: of the store [bytes]; all
    of the points that are known.
    """

    points: int
    solved: int
    failed: dict[str, int]
    seconds: float
    memory: float
    size: int

    @property
    def missing(self) -> int:
        """How many points are still to be solved."""
        return self.points - self.solved - sum(self.failed.values())


def engine(scheduler: str | None, workers: int) -> Engine:
    """Return what solves points: processes of this machine, or the workers of a Dask scheduler.

    Raises: MissingLibraryError; ParameterError where no scheduler answers.
    """
    if scheduler is None:
        return partial(on_processes, workers=workers)
    cluster = dask(scheduler)
    if scheduler != "local":
        cluster.need_answer(scheduler)
    return partial(on_cluster, address=scheduler, workers=workers)


def run(
    sweep: Sweep, store: Store, solve: Engine, tell: Callable[[Record], None], pilots: bool = False
) -> None:
    """Solve every point of the sweep that the store lacks, and keep each as it comes.

    Args: solve: see `engine`. tell: is called after each record is kept. pilots: only a few points,
    to estimate the cost of all.
    """
    places = None
    if pilots:
        places = {k * (sweep.count - 1) // (PILOTS - 1) for k in range(PILOTS)}
    for record in solve(_missing(sweep, store, places), sweep.settings):
        store.add(record)
        tell(record)


def _missing(sweep: Sweep, store: Store, places: set[int] | None) -> Iterator[Point]:
    """Points that the store lacks, each once; `places` in the order of the sweep or None."""
    begun = set(store.records)
    for place, point in enumerate(sweep.points(store.seed)):
        if (places is None or place in places) and (key := point.key(sweep.settings)) not in begun:
            begun.add(key)
            yield point


def costs(sweep: Sweep, store: Store) -> Report:
    """Return how far the sweep is, and what its points have cost."""
    keys = {point.key(sweep.settings) for point in sweep.points(store.seed)}
    known = [store.records[key] for key in keys & store.records.keys()]
    failed: dict[str, int] = {}
    for record in known:
        if "error" in record:
            failed[record["error"]] = failed.get(record["error"], 0) + 1
    took = [record["seconds"] for record in known]
    mean = sum(took) / len(took) if took else float("nan")
    memory = max((record["memory"] for record in known), default=0)
    solved = len(known) - sum(failed.values())
    return Report(
        len(keys), solved, dict(sorted(failed.items())), mean, memory, store.path.stat().st_size
    )


def need_room_for(report: Report, workers: int) -> None:
    """Refuse more workers on this machine than it has memory for, as far as points are known.

    Raises: ParameterError.
    """
    need_memory(report.memory * workers, f"{workers} workers", "lower --workers")
