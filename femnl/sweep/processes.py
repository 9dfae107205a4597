"""The points of a sweep on processes of this machine."""

import logging
from collections.abc import Iterator
from multiprocessing.connection import Connection

from femnl.core.processes import Death, Worker, answer, share_out
from femnl.sweep.point import Point, Record, Settings, failure
from femnl.sweep.solve import attempt


def on_processes(points: Iterator[Point], settings: Settings, workers: int) -> Iterator[Record]:
    """Solve points, `workers` at a time, and return each record as it comes."""
    answers = share_out(points, lambda: Worker(_serve, settings), workers, _died)
    for point, found in answers:
        record: Record = failure(point, settings, str(found)) if isinstance(found, Death) else found
        yield record


def _died(point: Point, code: int) -> None:
    logging.getLogger("femnl").warning("a worker died (exit code %d) at %s", code, point.varied)


def _serve(connection: Connection, settings: Settings) -> None:
    answer(connection, lambda point: attempt(point, settings))
