"""Workers of a Dask cluster, on this machine or many; the one module that imports dask."""

import logging
import socket
import warnings
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from itertools import islice
from typing import Any, TypeVar

import dask
from dask.utils import parse_timedelta
from distributed import Client, Future, LocalCluster, as_completed

from femnl.core.errors import ParameterError
from femnl.core.processes import scheduler_place

T = TypeVar("T")
LONGEST_GREETING = 2**20
"""Bytes of the first frame of a scheduler, which has some hundred."""


@dataclass(frozen=True)
class Where:
    """A scheduler, and what its workers must have in common with this process.

    address: such as "tcp://host:8786", or "local" for a cluster of `workers` processes on this
    machine. version: what this function returns must be the same everywhere. ahead: tasks that the
    scheduler holds at a time: enough for as many workers, few enough to be taken back at once.
    """

    address: str
    workers: int
    version: Callable[[], object]
    ahead: int


def share_out(
    tasks: Iterator[T],
    find: Callable[[Any], Any],
    where: Where,
    packed: Callable[[T], Any] | None = None,
) -> Iterator[tuple[T, Any]]:
    """Give tasks to the workers of a scheduler, and return each with its answer as it comes.

    How long to wait for the scheduler is Dask's own setting, `distributed.comm.timeouts.connect`.

    Args:
        tasks: taken one by one.
        find: answers a task; a function that workers can import.
        where: the scheduler.
        packed: makes of a task what is sent in its place.

    Returns: task and answer, or task and the exception in which it ended, such as
        `distributed.KilledWorker` where its workers died.
    Raises: ParameterError where there is no scheduler, where it goes, or where workers have another
    femnl.
    """
    _hush()
    try:
        with ExitStack() as stack, warnings.catch_warnings():
            # A file of some megabytes is one task, and no graph that is built the wrong way
            warnings.filterwarnings("ignore", "Sending large graph")
            client = _connect(stack, where)
            _check_workers(client, where)
            sent = _sent(client, tasks, find, packed)
            yield from _answered(sent, where)
    except OSError as error:
        raise _gone(where.address) from error


def need_answer(address: str) -> None:
    """Refuse an address where no Dask scheduler answers, before anything is begun.

    Raises: ParameterError.
    """
    _hush()
    with ExitStack() as stack:
        _connect(stack, Where(address, 0, object, 0))


def _hush() -> None:
    """Let Dask's own loggers, which tell of every step at levels of their own, be silent."""
    for name in list(logging.root.manager.loggerDict):
        if name.split(".")[0] == "distributed":
            logging.getLogger(name).setLevel(logging.CRITICAL)


def other_version(address: str, who: str) -> ParameterError:
    """Return the refusal of a worker that has another femnl."""
    return ParameterError(
        f"--scheduler {address}: {who} has another version of femnl; install the same everywhere"
    )


def _connect(stack: ExitStack, where: Where) -> Client:
    scheduler: Any = where.address
    if where.address == "local":
        scheduler = stack.enter_context(
            LocalCluster(n_workers=where.workers, threads_per_worker=1, dashboard_address=None)
        )
    try:
        if where.address != "local":
            _need_greeting(where.address)
        client: Client = stack.enter_context(Client(scheduler))
    except (OSError, ValueError, TypeError) as error:
        raise ParameterError(
            f"--scheduler {where.address}: no Dask scheduler answers ({error}); start one with "
            "`dask scheduler`"
        ) from error
    return client


def _need_greeting(address: str) -> None:
    """Raise OSError where what listens is no scheduler, for which Dask would wait without end.

    A scheduler begins at once with a frame of at most a few kilobytes, its length in front.
    """
    at = scheduler_place(address)
    if at is None or address.startswith("tls"):
        return
    patience = parse_timedelta(dask.config.get("distributed.comm.timeouts.connect"))
    try:
        with socket.create_connection(at, timeout=patience) as connection:
            head = connection.recv(8, socket.MSG_WAITALL)
    except TimeoutError as error:
        raise OSError(f"silent for {patience:g} s") from error
    if len(head) < 8 or int.from_bytes(head, "little") > LONGEST_GREETING:
        raise OSError("what listens there is none")


def _sent(
    client: Client,
    tasks: Iterator[T],
    find: Callable[[Any], Any],
    packed: Callable[[T], Any] | None,
) -> Iterator[tuple[Future[Any], T]]:
    """Send tasks, each when it is asked for."""
    for task in tasks:
        what = task if packed is None else packed(task)
        yield client.submit(_on_worker, find, what, pure=False), task


def _on_worker(find: Callable[[Any], Any], task: Any) -> Any:
    """Answer a task.

    Its files belong to this worker alone, so xarray needs no lock of the cluster.
    """
    with dask.config.set(scheduler="synchronous"):
        return find(task)


def _answered(sent: Iterator[tuple[Future[Any], T]], where: Where) -> Iterator[tuple[T, Any]]:
    under_way = dict(islice(sent, where.ahead))
    finished = as_completed(list(under_way))
    for future in finished:
        yield under_way.pop(future), _answer(future, where.address)
        more = dict(islice(sent, 1))
        under_way.update(more)
        finished.update(list(more))


def _answer(future: Future[Any], address: str) -> Any:
    if future.status in ("cancelled", "lost"):
        raise _gone(address)
    return future.exception() if future.status == "error" else future.result()


def _gone(address: str) -> ParameterError:
    return ParameterError(
        f"--scheduler {address}: the scheduler has gone; start it again and repeat the command, "
        "which goes on from here"
    )


def _check_workers(client: Client, where: Where) -> None:
    """Refuse workers that could only fail; there may be none yet."""
    try:
        versions = client.run(where.version)
    except ImportError as error:
        raise ParameterError(
            f"--scheduler {where.address}: its workers cannot import femnl ({error}); install it "
            "in their environment"
        ) from error
    except AttributeError as error:  # an older one lacks the function
        raise other_version(where.address, "a worker") from error
    for worker, version in versions.items():
        if version != where.version():
            raise other_version(where.address, worker)
