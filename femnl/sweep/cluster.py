"""The points of a sweep on the workers of a Dask cluster."""

from collections.abc import Iterator
from functools import partial

from femnl.core.processes import dask
from femnl.sweep.point import VERSION, Point, Record, Settings, failure
from femnl.sweep.solve import attempt

AHEAD = 2000
"""Points that the scheduler holds at a time."""


def on_cluster(
    points: Iterator[Point], settings: Settings, address: str, workers: int
) -> Iterator[Record]:
    """Solve points on the workers of a scheduler and return each record as it comes.

    Args: address, workers: see `femnl.core.cluster.Where`.
    Raises: ParameterError where there is no scheduler, where it goes, or where workers have another
    femnl.
    """
    cluster = dask(address)
    where = cluster.Where(address, workers, _version, AHEAD)
    find = partial(attempt, settings=settings)
    for point, found in cluster.share_out(points, find, where):
        if isinstance(found, BaseException):
            yield failure(point, settings, f"on the cluster: {found!r}")
            continue
        # A worker that came later may have another femnl than those that were asked
        if found["key"] != point.key(settings):
            raise cluster.other_version(address, "a worker")
        yield found


def _version() -> int:
    return VERSION
