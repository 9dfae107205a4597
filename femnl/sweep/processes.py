"""Workers in processes of this machine: one point at a time in each, and a death that costs that point alone."""

import logging
import os
import signal
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing import get_context
from multiprocessing.connection import Connection, wait

from femnl.sweep.point import Point, Record, Settings, attempt, failure

TRIES = 3
"""How often a point is begun whose process dies, before it counts as failed."""
_CONTEXT = get_context("spawn")  # a fork would copy the state of meshers and solvers


class _Worker:
    """A process that solves what it is sent until its connection closes."""

    def __init__(self, settings: Settings) -> None:
        self.connection, theirs = _CONTEXT.Pipe()
        self.process = _CONTEXT.Process(target=_serve, args=(theirs, settings), daemon=True)
        # The process inherits the mask: an interrupt from the keyboard reaches the client alone, which ends its workers.
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            self.process.start()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
        theirs.close()

    def give(self, point: Point) -> bool:
        """Send a point; whether the process is there to take it."""
        try:
            self.connection.send(point)
        except BrokenPipeError:
            return False
        return True

    def take(self) -> Record | None:
        """Receive the record of the point sent last; None where the process has died."""
        try:
            record: Record = self.connection.recv()
        except (EOFError, ConnectionResetError):
            return None
        return record

    def stop(self) -> int:
        """End the process at once; its exit code."""
        self.process.kill()
        self.process.join()
        self.connection.close()
        return self.process.exitcode or 0


def on_processes(points: Iterator[Point], settings: Settings, workers: int) -> Iterator[Record]:
    """Solve points, `workers` at a time, and return each record as it comes."""
    idle: list[_Worker] = []
    busy: dict[Connection, tuple[_Worker, Point]] = {}
    again: list[Point] = []
    deaths: Counter[str] = Counter()
    with _one_thread():
        try:
            while True:
                while len(busy) < workers and (point := again.pop() if again else next(points, None)) is not None:
                    worker = idle.pop() if idle else _Worker(settings)
                    if worker.give(point):
                        busy[worker.connection] = worker, point
                    else:
                        worker.stop()
                        again.append(point)
                if not busy:
                    return
                for ready in wait(list(busy)):
                    worker, point = busy.pop(next(c for c in busy if c is ready))
                    record = worker.take()
                    if record is not None:
                        idle.append(worker)
                        yield record
                        continue
                    code, key = worker.stop(), point.key(settings)
                    deaths[key] += 1
                    logging.getLogger("femnl").warning("a worker died (exit code %d) at %s", code, point.varied)
                    if deaths[key] < TRIES:
                        again.append(point)
                    else:
                        yield failure(point, settings, f"its process died {TRIES} times (exit code {code}; −9 is mostly lack of memory)")
        finally:
            for worker in [*idle, *(worker for worker, _ in busy.values())]:
                worker.stop()


def _serve(connection: Connection, settings: Settings) -> None:
    """Answer every point that comes; the client's end closes the connection, and with it this process."""
    try:
        while True:
            connection.send(attempt(connection.recv(), settings))
    except (EOFError, ConnectionError):
        return


@contextmanager
def _one_thread() -> Iterator[None]:
    """Processes that are started meanwhile use one thread each: side by side, more only slow them down."""
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
