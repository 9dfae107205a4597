"""Processes of this machine that answer tasks one at a time until their connection closes."""

import os
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import Any

_CONTEXT = get_context("spawn")  # a fork would copy the state of meshers and solvers


class Worker:
    """A process that runs `serve(connection, *about)`, and the other end of its connection."""

    def __init__(self, serve: Callable[..., None], *about: object) -> None:
        self.connection, theirs = _CONTEXT.Pipe()
        self.process = _CONTEXT.Process(target=serve, args=(theirs, *about), daemon=True)
        # The process inherits the mask: an interrupt from the keyboard reaches the client alone,
        # which ends its workers.
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            self.process.start()
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


def answer(connection: Connection, find: Callable[[Any], Any]) -> None:
    """Answer every task that comes.

    The client's end closes the connection, and with it this process.
    """
    try:
        while True:
            connection.send(find(connection.recv()))
    except (EOFError, ConnectionError):
        return


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
