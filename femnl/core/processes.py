"""Processes of this machine that answer tasks one at a time until their connection closes."""

import os
import signal
import socket
from collections import deque
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib import import_module
from multiprocessing import get_context, parent_process
from multiprocessing.connection import Connection, wait
from multiprocessing.reduction import ForkingPickler
from threading import Thread
from types import ModuleType
from typing import Any, TypeVar

from femnl.core.errors import MissingLibraryError, ParameterError, leave_out_warnings

T = TypeVar("T")
TRIES = 3
"""How often a task is begun whose process dies, before it counts as failed."""
DASK_PORT = 8786
"""Of a Dask scheduler whose address names none."""
PROBE = 1.0
"""Seconds in which a host that is there accepts or refuses a connection."""
ORPHANED = 3
"""Exit code of a process whose parent has gone, which nobody reads."""
UNGUARDED = (
    "a script that asks for more than one process keeps what it runs under "
    'if __name__ == "__main__":'
)
"""What the processes say that load a script without that, and end."""
_CONTEXT = get_context("spawn")  # a fork would copy the state of meshers and solvers


@dataclass(frozen=True)
class Death:
    """What a task came to whose process died each time; `exit_code` is that of the last."""

    exit_code: int

    def __str__(self) -> str:
        """Say it, and what it is mostly due to."""
        return (
            f"its process died {TRIES} times (exit code {self.exit_code}; −9 is mostly lack of "
            "memory)"
        )


class Worker:
    """A process that runs `serve(connection, *about)`, and the other end of its connection."""

    def __init__(self, serve: Callable[..., None], *about: object) -> None:
        self.connection, theirs = _CONTEXT.Pipe()
        # Packed, so that the process watches its parent before it loads what it serves
        work = ForkingPickler.dumps((serve, about))
        self.process = _CONTEXT.Process(target=_begin, args=(theirs, bytes(work)), daemon=True)
        # The process inherits the mask: an interrupt from the keyboard reaches the client alone,
        # which ends its workers.
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            self.process.start()
        except RuntimeError as error:
            # Python refuses this to a process that still loads the script of the one that began it
            raise SystemExit(UNGUARDED) from error
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
        theirs.close()

    def give(self, task: Any) -> bool:
        """Send a task; whether the process is there to take it."""
        try:
            self.connection.send(task)
        except ConnectionError:
            return False
        return True

    def take(self) -> Any:
        """Receive what the task sent last came to; None where the process has died."""
        try:
            return self.connection.recv()
        except (EOFError, ConnectionError):
            return None

    def stop(self) -> int:
        """End the process at once; its exit code."""
        self.process.kill()
        self.process.join()
        self.connection.close()
        return self.process.exitcode or 0


def _begin(connection: Connection, work: bytes) -> None:
    """Serve in a process that ends with the one that started it, whatever it is busy with.

    Args: work: what to call with the connection, and with what else, as `ForkingPickler` packs it.
    """
    Thread(target=_end_with_parent, daemon=True).start()
    leave_out_warnings()
    serve, about = ForkingPickler.loads(work)
    with suppress(ConnectionError):  # the client may go while this process loads what it serves
        serve(connection, *about)


def _end_with_parent() -> None:
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(ORPHANED)


def answer(connection: Connection, find: Callable[[Any], Any]) -> None:
    """Answer every task that comes.

    The client's end closes the connection, and with it this process.
    """
    try:
        while True:
            connection.send(find(connection.recv()))
    except (EOFError, ConnectionError):
        return


def share_out(
    tasks: Iterator[T],
    start: Callable[[], Worker],
    workers: int,
    died: Callable[[T, int], None],
) -> Generator[tuple[T, Any], None, None]:
    """Give tasks to processes, one at a time to each, and return each with its answer as it comes.

    A death costs its own task alone, which is begun again up to `TRIES` times in all.

    Args:
        tasks: taken one by one, as processes are free.
        start: starts a process.
        workers: how many processes there are at most.
        died: is called with the task and the exit code after each death.

    Returns: task and answer, or task and `Death`.
    """
    idle: list[Worker] = []
    busy: dict[Connection, tuple[Worker, T, int]] = {}
    again: deque[tuple[T, int]] = deque()

    def given(task: T, deaths: int) -> None:
        worker = idle.pop() if idle else start()
        if worker.give(task):
            busy[worker.connection] = worker, task, deaths
        else:  # it died before it had anything to do
            worker.stop()
            again.append((task, deaths))

    with one_thread():
        try:
            while True:
                while len(busy) < workers and (todo := _next(again, tasks)) is not None:
                    given(*todo)
                if not busy:
                    return
                for ready in wait(list(busy)):
                    worker, task, deaths = busy.pop(next(c for c in busy if c is ready))
                    answered = worker.take()
                    if answered is not None:
                        idle.append(worker)
                        yield task, answered
                        continue
                    code = worker.stop()
                    died(task, code)
                    if deaths + 1 < TRIES:
                        again.append((task, deaths + 1))
                    else:
                        yield task, Death(code)
        finally:
            for worker in [*idle, *(worker for worker, _, _ in busy.values())]:
                worker.stop()


def _next(again: deque[tuple[T, int]], tasks: Iterator[T]) -> tuple[T, int] | None:
    """Return a task and the deaths that it has had: one that is begun again, else a new one."""
    if again:
        return again.popleft()
    for task in tasks:
        return task, 0
    return None


def need_scheduler(scheduler: str) -> None:
    """Refuse the address of a scheduler where nobody can answer, before Dask is loaded.

    A host that stays silent is left to Dask, whose setting says how long to wait for it.

    Args: scheduler: such as "tcp://host:8786". Raises: ParameterError.
    """
    try:
        at = scheduler_place(scheduler)
        if at is not None:
            socket.create_connection(at, timeout=PROBE).close()
    except TimeoutError:
        return
    except (OSError, ValueError, OverflowError) as error:
        why = error.strerror if isinstance(error, OSError) else error
        raise ParameterError(
            f"--scheduler {scheduler}: no Dask scheduler answers ({why}); start one with "
            "`dask scheduler`, or check the address"
        ) from error


def scheduler_place(address: str) -> tuple[str, int] | None:
    """Return host and port of an address; None for protocols other than TCP.

    Raises: ValueError for a port that is no number.
    """
    protocol, _, place = address.rpartition("://")
    if protocol not in ("", "tcp", "tls"):
        return None
    host, colon, port = place.rpartition(":")
    return (host.strip("[]"), int(port)) if colon else (place, DASK_PORT)


def dask(scheduler: str) -> ModuleType:
    """Return `femnl.core.cluster`, which shares tasks out to the workers of a Dask scheduler.

    Raises: MissingLibraryError where dask is not installed.
    """
    try:
        return import_module("femnl.core.cluster")
    except ModuleNotFoundError as error:
        raise MissingLibraryError(
            f"--scheduler {scheduler}: needs {error.name}, which is not installed; pip install "
            "'femnl[dask]'"
        ) from error


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Linear algebra within takes one thread.

    Factors of sparse matrices are dense in small blocks: with a second thread the modes of the
    perforated square took 32 s of processor time instead of 9 s.
    """
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1, user_api="blas"):
        yield


@contextmanager
def one_thread() -> Iterator[None]:
    """Processes that are started meanwhile use one thread each.

    Side by side, more only slow them down.
    """
    names = [f"{library}_NUM_THREADS" for library in ("OMP", "OPENBLAS", "MKL")]
    before = {name: os.environ.get(name) for name in names}
    os.environ.update(dict.fromkeys(names, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
