"""Workers in processes of this machine.

One point at a time in each, and a death that costs that point alone.
"""

import logging
from collections import Counter
from collections.abc import Iterator
from multiprocessing.connection import Connection, wait

from femnl.core.processes import Worker, answer, one_thread
from femnl.sweep.point import Point, Record, Settings, attempt, failure

TRIES = 3
"""How often a point is begun whose process dies, before it counts as failed."""


def on_processes(points: Iterator[Point], settings: Settings, workers: int) -> Iterator[Record]:
    """Solve points, `workers` at a time, and return each record as it comes."""
    idle: list[Worker] = []
    busy: dict[Connection, tuple[Worker, Point]] = {}
    again: list[Point] = []
    deaths: Counter[str] = Counter()
    with one_thread():
        try:
            while True:
                while (
                    len(busy) < workers
                    and (point := again.pop() if again else next(points, None)) is not None
                ):
                    worker = idle.pop() if idle else Worker(_serve, settings)
                    if worker.give(point):
                        busy[worker.connection] = worker, point
                    else:
                        worker.stop()
                        again.append(point)
                if not busy:
                    return
                for ready in wait(list(busy)):
                    worker, point = busy.pop(next(c for c in busy if c is ready))
                    record: Record | None = worker.take()
                    if record is not None:
                        idle.append(worker)
                        yield record
                        continue
                    code = worker.stop()
                    key = point.key(settings)
                    deaths[key] += 1
                    logging.getLogger("femnl").warning(
                        "a worker died (exit code %d) at %s", code, point.varied
                    )
                    if deaths[key] < TRIES:
                        again.append(point)
                    else:
                        yield failure(
                            point,
                            settings,
                            f"its process died {TRIES} times (exit code {code}; −9 is mostly "
                            "lack of memory)",
                        )
        finally:
            for worker in [*idle, *(worker for worker, _ in busy.values())]:
                worker.stop()


def _serve(connection: Connection, settings: Settings) -> None:
    answer(connection, lambda point: attempt(point, settings))
