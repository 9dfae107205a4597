"""Workers of a Dask cluster, on this machine or many; the one module that imports dask."""

import logging
from collections.abc import Iterator
from contextlib import ExitStack
from itertools import islice

from distributed import Client, Future, LocalCluster, as_completed

from femnl.core.errors import ParameterError
from femnl.sweep.point import VERSION, Point, Record, Settings, attempt, failure

AHEAD = 2000
"""Points that the scheduler holds at a time: enough for as many workers, few enough to be taken
back at once.
"""


def on_cluster(
    points: Iterator[Point], settings: Settings, address: str, workers: int
) -> Iterator[Record]:
    """Solve points on the workers of a scheduler and return each record as it comes.

    How long to wait for the scheduler is Dask's own setting, `distributed.comm.timeouts.connect`.

    Args: address: such as "tcp://host:8786", or "local" for a cluster of `workers` processes on
    this machine.
    Raises: ParameterError where there is no scheduler, where it goes, or where workers have another
    femnl.
    """
    for name in list(logging.root.manager.loggerDict):
        if name.split(".")[0] == "distributed":  # which tells of every step at levels of its own
            logging.getLogger(name).setLevel(logging.CRITICAL)
    try:
        with ExitStack() as stack:
            yield from _solved(_connect(stack, address, workers), points, settings, address)
    except OSError as error:
        raise _gone(address) from error


def _connect(stack: ExitStack, address: str, workers: int) -> Client:
    where = address
    if address == "local":
        where = stack.enter_context(
            LocalCluster(n_workers=workers, threads_per_worker=1, dashboard_address=None)
        )
    try:
        client: Client = stack.enter_context(Client(where))
    except (OSError, ValueError, TypeError) as error:
        raise ParameterError(
            f"--scheduler {address}: no Dask scheduler answers ({error}); start one with `dask "
            "scheduler`"
        ) from error
    return client


def _solved(
    client: Client, points: Iterator[Point], settings: Settings, address: str
) -> Iterator[Record]:
    _check_workers(client, address)
    sent: dict[Future[Record], Point] = {}

    def send(number: int) -> list[Future[Record]]:
        futures = {
            client.submit(attempt, point, settings, pure=False): point
            for point in islice(points, number)
        }
        sent.update(futures)
        return list(futures)

    finished = as_completed(send(AHEAD))
    for future in finished:
        yield _record(future, sent.pop(future), settings, address)
        finished.update(send(1))


def _record(future: Future[Record], point: Point, settings: Settings, address: str) -> Record:
    if future.status in ("cancelled", "lost"):
        raise ParameterError(
            f"--scheduler {address}: the scheduler has gone; start it again and repeat the "
            "command, which goes on from here"
        )
    if future.status == "error":
        return failure(point, settings, f"on the cluster: {future.exception()!r}")
    record = future.result()
    if record["key"] != point.key(settings):
        raise ParameterError(
            f"--scheduler {address}: a worker has another version of femnl; install the same "
            "everywhere"
        )
    return record


def _gone(address: str) -> ParameterError:
    return ParameterError(
        f"--scheduler {address}: the scheduler has gone; start it again and repeat the command, "
        "which goes on from here"
    )


def _version() -> int:
    return VERSION


def _check_workers(client: Client, address: str) -> None:
    """Refuse workers that could only fail; there may be none yet."""
    try:
        versions = client.run(_version)
    except ImportError as error:
        raise ParameterError(
            f"--scheduler {address}: its workers cannot import femnl ({error}); install it in "
            "their environment"
        ) from error
    for worker, version in versions.items():
        if version != VERSION:
            raise ParameterError(
                f"--scheduler {address}: {worker} has another version of femnl; install the same "
                "everywhere"
            )
