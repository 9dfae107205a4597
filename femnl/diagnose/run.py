"""From a measurement file to a diagnosis."""

import hashlib
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from femnl.core.checkpoint import Checkpoint, remembered
from femnl.core.diagnosis import Diagnosis
from femnl.core.effect import Effect
from femnl.core.errors import ParameterError, numbers_of
from femnl.core.processes import one_blas_thread
from femnl.diagnose.candidate import Candidate
from femnl.diagnose.conclude import conclude
from femnl.diagnose.joint import JointModel
from femnl.diagnose.noise_of_file import (
    Noise,
    first_noise,
    last_noise,
    told_glitches,
    told_noise,
)
from femnl.diagnose.posing import Posing, opened
from femnl.diagnose.search import SIZES, better, refitted, search
from femnl.diagnose.sent import considered, sent
from femnl.diagnose.verdict import NOISE_IS_LARGER
from femnl.diagnose.worker_pool import Pose, Posed, Run, WorkerPool, worker_pool
from femnl.effects import fingerprint
from femnl.io import measurement
from femnl.observe.model import MeasurementModel
from femnl.observe.noisy import FoundNoise

OF_DEVICES = frozenset({"pitch_square", "layer_thickness"})
"""Scales that a measurement lacks only where its device has no holes, or no layers."""
SEARCHES = 3
"""Searches at most: where the best set of causes shows other noise than was known, causes are
sought again with that.
"""


def diagnose(
    path: str | Path,
    geometry: str | None = None,
    effects: Iterable[Effect] | None = None,
    workers: int = 1,
) -> Diagnosis:
    """Say whether the simulation explains a measurement, and if not, which physical cause does.

    Args:
        path: a measurement file, version 1.x.
        geometry: name or path of a geometry to use instead of the file's own; a record of drive and
            output needs none.
        effects: the causes to consider; the whole library unless given.
        workers: processes that fit side by side, this one among them. A script that asks for more
            than one keeps what it runs under `if __name__ == "__main__"`, and effects of its own in
            a module, or in a folder that `femnl.effects.from_folder` reads.

    Returns: the diagnosis, see docs/reference/diagnosis-json.md; the same whatever the workers.
    Raises: MeasurementError, GeometryError, ConvergenceError, ParameterError.
    Valid: noise normal, of the standard deviation that the file states or the data show. Fits are
        kept in the user's cache until all are done: the same call after an interruption goes on
        where it stopped.
    """
    if workers < 1:
        raise ParameterError(f"workers: {workers} is none; give a whole number of at least 1")
    path = Path(path)
    with numbers_of(str(path)):
        return _diagnosed(path, geometry, effects, workers)


def _diagnosed(
    path: Path, geometry: str | None, effects: Iterable[Effect] | None, workers: int
) -> Diagnosis:
    measurement.need_room(path, "diagnose", workers)
    tree, model = opened(path, geometry)
    pool = considered(effects)
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    # Thousands of matrices of a few dozen rows: threads gain nothing there, and beside other work
    # they wait for each other.
    with (
        remembered(digest, model, fingerprint(pool)) as checkpoint,
        one_blas_thread(),
        worker_pool(workers, checkpoint) as processes,
    ):
        posing = Posing(path, geometry, sent(pool, workers))
        noise = _first_noise(posing, checkpoint)
        found: list[Candidate] = []
        for left in reversed(range(SEARCHES)):
            searching = _Searching(partial(posing, noise=noise), processes, checkpoint, noise)
            found, run = searching.searched(found)
            best = max(found, key=lambda candidate: candidate.weight)
            seen = last_noise(best, noise)
            if seen == noise or not left:
                break
            noise = seen
        notes = (*tree.attrs.get("repairs", ()), *_notes(found, pool))
        names = decided(pool, found[0].result.model.base_model)
        concluded = conclude(str(path), digest, found, notes, run, names)
        factor = 1.0
        if concluded.rule in NOISE_IS_LARGER:
            factor = next(c.factor for c in found if c.names == concluded.causes)
        noisy = replace(
            concluded,
            excluded=told_glitches(best.result, noise),
            noise=told_noise(best.result, noise, factor),
        )
    return replace(noisy, geometry=geometry, model=model)


def decided(pool: list[Effect], model: MeasurementModel) -> frozenset[str]:
    """Return the names of effects that were sought, or that the device cannot have."""
    absent = OF_DEVICES - model.scales.keys()
    sought = {effect.name for effect in model.usable_effects(pool)}
    return frozenset(sought | {effect.name for effect in pool if absent & set(effect.needs)})


def _notes(found: list[Candidate], effects: list[Effect]) -> tuple[str, ...]:
    model = found[0].result.model.base_model
    return (*model.notes, *model.ruled_out(effects))


def _first_noise(posing: Callable[..., Posed], checkpoint: Checkpoint) -> Noise:
    """Return the noise of each measurement before causes are sought."""
    model, effects = posing(checkpoint)
    if isinstance(model, JointModel):
        return {
            name: first_noise(group, group.usable_effects(model.originals.values()), checkpoint)
            for name, group in model.groups.items()
        }
    return {"": first_noise(model, effects, checkpoint)}


@dataclass(frozen=True)
class _Searching:
    """The search for causes of one measurement, or of several jointly.

    pose: poses the model and its effects. processes: those that fit. noise: that the model has.
    """

    pose: Callable[..., Posed]
    processes: WorkerPool
    checkpoint: Checkpoint
    noise: Noise

    def searched(self, earlier: list[Candidate]) -> tuple[list[Candidate], Run]:
        """Fit what may explain the data.

        Args: earlier: what was found under another noise, if anything. It is fitted again, and
            nothing is sought where that explains the data, or where sets of all sizes were sought.
        Returns: what was fitted, and what does further jobs of that problem.
        """
        found, run = self._sought(self.pose, earlier)
        base_model = found[0].result.model.base_model
        if (
            not isinstance(base_model, JointModel)
            or any(candidate.viable for candidate in found)
            or "wavelength" not in base_model.scales
        ):
            return found, run
        # Which way the film moves at a phase of the drive is not known, and two wavelengths
        # together tell it.
        other = self._sought(partial(self.pose, backwards=True), [])
        return max(((found, run), other), key=lambda one: max(c.weight for c in one[0]))

    def _sought(self, pose: Pose, earlier: list[Candidate]) -> tuple[list[Candidate], Run]:
        posed = self.processes.posed(pose)
        model, library, run = posed.model, posed.effects, posed.run
        if earlier:
            again = refitted(model, library, earlier, run)
            explained = any(candidate.viable and candidate.names for candidate in again)
            went_through = any(len(candidate.names) == len(SIZES) for candidate in earlier)
            if explained or went_through:  # which sets to try hardly depends on the noise
                return again, run
            # Cut short, so that this one begins with the noise that it showed
            found = search(model, library, run, self.checkpoint)
            return better(found, again), run
        return search(model, library, run, self.checkpoint, self._other), run

    def _other(self, best: Candidate) -> float | None:
        """Return the noise that causes leave over that of the model, None where it is the same.

        It is never another where neighbours cannot tell the noise: there more causes may take up
        what looks like noise. Of several measurements, no one factor says how it differs: 1.
        """
        if not best.result.model.base_model.tells_noise:
            return None
        left = last_noise(best, self.noise)
        if left == self.noise:
            return None
        if len(left) > 1:
            return 1.0
        ((name, found),) = left.items()
        return found.factor / self.noise.get(name, FoundNoise()).factor
