"""Fits that do not wait for each other, side by side.

Here, and in processes that pose the same problem.
"""

import logging
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from time import perf_counter
from typing import Any, Generic, TypeVar

from femnl.core.checkpoint import Checkpoint, Found, Share
from femnl.core.effect import Effect
from femnl.core.errors import FemnlError
from femnl.core.processes import Worker, answer, one_thread
from femnl.diagnose.by_name import ByName
from femnl.observe.model import MeasurementModel

PROGRESS = logging.getLogger("femnl.progress")
WARNINGS = logging.getLogger("femnl")
T = TypeVar("T")
Posed = tuple[MeasurementModel, list[Effect]]
"""A model, and the effects that may explain its deviations."""
Pose = Callable[[Checkpoint | None], Posed]
"""Poses a model, with the checkpoint that its process has."""
SOON = 0.05
EXIT = 5.0
"""Seconds after which it is asked again whether a helper is ready, and those that one may take to
end.
"""


@dataclass(frozen=True)
class Job(Generic[T]):
    """Something to find, and the line of progress that says so.

    causes: those of the set that it is about.
    """

    says: str
    find: Callable[[], T]
    causes: tuple[str, ...] = ()

    def done(self) -> T:
        """Say it and find it."""
        PROGRESS.info(self.says)
        return self.find()


Run = Callable[[Sequence[Job[Any]]], list[Any]]
"""Does jobs that do not wait for each other, and returns what they find, in their order."""


def in_turn(jobs: Sequence[Job[T]]) -> list[T]:
    """Do one job after the other."""
    return [job.done() for job in jobs]


class WorkerPool:
    """Processes that help this one with one problem after the other."""

    def __init__(self, helpers: int, checkpoint: Checkpoint | None) -> None:
        self._checkpoint = checkpoint
        path = None if checkpoint is None else checkpoint.path
        with one_thread():
            self._helpers = [_Helper(path) for _ in range(helpers)]

    def posed(self, pose: Pose) -> "Problem":
        """Pose a problem, here first.

        What that leaves on disk, as the modes of a film, helpers need not solve again.
        """
        return Problem(pose, pose(self._checkpoint), self._helpers, self._checkpoint)

    def end(self) -> None:
        """End the helpers at once."""
        for helper in self._helpers:
            helper.stop()


@contextmanager
def worker_pool(workers: int, checkpoint: Checkpoint | None = None) -> Iterator[WorkerPool]:
    """Start so many processes, this one among them.

    They load what they need while this one goes on.
    """
    mine = WorkerPool(workers - 1, checkpoint)
    try:
        yield mine
    finally:
        mine.end()


class Problem:
    """A model with the effects that may explain its deviations, and who does the jobs on it.

    This process and its helpers take jobs as soon as they are there. Model and effects go by name,
    as each process has its own; what else jobs and results hold is sent. What a helper finds is
    what this process would find, to the last bit, and its fits come into the checkpoint here.
    """

    def __init__(
        self, pose: Pose, posed: Posed, helpers: "list[_Helper]", checkpoint: Checkpoint | None
    ) -> None:
        self.model, self.effects = posed
        self._pose = pose
        self._names = ByName(*posed, checkpoint)
        self._helpers = helpers
        self._checkpoint = checkpoint
        self._fits: deque[tuple[str, Found]] = deque()
        self._lasted: dict[str, float] = {}
        for helper in helpers:
            helper.turn_to(pose)

    def run(self, jobs: Sequence[Job[T]]) -> list[T]:
        """Do all jobs; return what they find, in their order.

        Those that may last longest are begun first, lest all wait for the last one.
        """
        if not self._helpers or len(jobs) < 2:
            return in_turn(jobs)
        todo = deque(sorted(enumerate(jobs), key=lambda its: -self._expected(its[1])))
        found = dict[int, T]()
        while todo:  # again, where a helper ended over its job
            with self._fed(todo, found):
                while (mine := _next(todo.popleft)) is not None:
                    begin = perf_counter()
                    found[mine[0]] = mine[1].done()
                    self._lasted_since(begin, mine[1])
                    self._keep()
            self._keep()
            for helper in [helper for helper in self._helpers if helper.dead]:
                helper.process.join(EXIT)  # it has closed its end and may be about to say why
                WARNINGS.warning(
                    "a helper ended (exit code %d); its fits are made here", helper.stop()
                )
                self._helpers.remove(helper)
        return [found[i] for i in range(len(jobs))]

    def _expected(self, job: Job[Any]) -> float:
        """Return how long [s] a job may last: as the latest about one of its causes alone."""
        return max((self._lasted.get(cause, 0.0) for cause in job.causes), default=0.0)

    def _lasted_since(self, begin: float, job: Job[Any]) -> None:
        if len(job.causes) == 1:
            self._lasted[job.causes[0]] = perf_counter() - begin

    @contextmanager
    def _fed(self, todo: "deque[tuple[int, Job[T]]]", found: dict[int, T]) -> Iterator[None]:
        """Let helpers do jobs meanwhile; where this process fails, they end over theirs."""
        with ThreadPoolExecutor(max(len(self._helpers), 1)) as threads:
            feeding = [threads.submit(self._feed, helper, todo, found) for helper in self._helpers]
            try:
                yield
                for one in feeding:
                    one.result()
            except BaseException:
                todo.clear()
                for helper in self._helpers:
                    helper.process.kill()
                raise

    def _feed(
        self, helper: "_Helper", todo: "deque[tuple[int, Job[T]]]", found: dict[int, T]
    ) -> None:
        """Let a helper do jobs."""
        helper.turn_to(self._pose)
        while todo and not helper.dead:
            if helper.ready(SOON) and (its := _next(todo.popleft)) is not None:
                PROGRESS.info(its[1].says)
                begin = perf_counter()
                answered = helper.ask(self._names.packed(its[1].find))
                if answered is None:
                    todo.appendleft(its)
                else:
                    self._lasted_since(begin, its[1])
                    found[its[0]], fits = self._names.unpacked(answered)
                    self._fits.extend(fits)

    def _keep(self) -> None:
        """Put the fits of helpers into the checkpoint."""
        while (fit := _next(self._fits.popleft)) is not None:
            if self._checkpoint is not None:
                self._checkpoint.add(*fit)


class _Helper(Worker):
    """A process that poses one problem after the other, and does jobs on the last."""

    def __init__(self, checkpoint: Path | None) -> None:
        super().__init__(_serve, checkpoint)
        self.dead = False
        self._pose: Pose | None = None
        self._posing = 0

    def turn_to(self, pose: Pose) -> None:
        """Let it pose a problem, unless that is the one that it has."""
        if self._pose is not pose:
            self._pose = pose
            self._posing += 1
            self.dead = not self.give(pose)

    def ready(self, seconds: float) -> bool:
        """Whether it has posed its problem within some seconds."""
        while self._posing and not self.dead and self.connection.poll(seconds):
            self._posing -= 1
            self.dead = self.take() is None
        return not self._posing and not self.dead

    def ask(self, task: bytes) -> Any:
        """Return its answer, None where it has died."""
        answered = self.take() if self.give(task) else None
        self.dead = answered is None
        return answered


def _serve(connection: Connection, path: Path | None) -> None:
    """Pose problems, and do jobs on the last: return what each found with the fits that it made."""
    # The process that asked meets the same file, cache and fits, and says once what there is to say
    # of them.
    WARNINGS.setLevel(logging.CRITICAL)
    posed: list[tuple[ByName, Share | None]] = []

    def pose(problem: Pose) -> bool:
        share = None if path is None else Share(path)
        posed[:] = [(ByName(*problem(share), share), share)]
        return True

    def find(task: bytes) -> bytes:
        ((names, share),) = posed
        found = names.unpacked(task)()
        return names.packed((found, [] if share is None else share.taken()))

    def do(task: bytes | Pose) -> bytes | bool:
        try:
            return find(task) if isinstance(task, bytes) else pose(task)
        # The same fails in the process that asked, which tells the user
        except FemnlError as error:
            raise SystemExit(1) from error

    answer(connection, do)


def _next(take: Callable[[], T]) -> T | None:
    """Take what is left; two threads may want the last."""
    try:
        return take()
    except IndexError:
        return None
