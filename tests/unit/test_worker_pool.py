"""Jobs that are done side by side.

By whom, what they find, and what a death, an error or an interrupt costs.
"""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest

from femnl.core.checkpoint import Checkpoint, remembered
from femnl.core.effect import Effect, ParameterSpec, Values
from femnl.core.errors import MeasurementError, ParameterError
from femnl.core.readout import Array
from femnl.diagnose import diagnose, record
from femnl.diagnose.by_name import ByName
from femnl.diagnose.criticism import criticise
from femnl.diagnose.search import refitted
from femnl.diagnose.worker_pool import Job, worker_pool
from femnl.effects import library
from femnl.fits.least_squares import FitResult, fit
from femnl.io import measurement
from femnl.observe.extended import ExtendedModel
from femnl.observe.model import MeasurementModel
from tests.unit.level import Level

BLOCKS = np.repeat(np.arange(4), 10)
ORDERS = np.array([(1, 1), (1, 2), (2, 1), (2, 2), (1, 3), (3, 1), (2, 3), (3, 2)])
FEW = ("stress_anisotropy", "tension_gradient")
Run = Callable[[Sequence[Job[int]]], list[int]]


def lift(value: Array, values: Values) -> Array:
    return value + values["strength"] * np.linspace(-1, 1, len(value))


SLOPE = Effect(
    "slope", "", (ParameterSpec("strength", "1", -10.0, 10.0),), {"placement": lift}, "", "", ""
)


def posed(checkpoint: Checkpoint | None = None) -> tuple[MeasurementModel, list[Effect]]:
    return Level(
        3 + 2 * np.linspace(-1, 1, 40) + np.random.default_rng(1).standard_normal(40), BLOCKS, 100.0
    ), [SLOPE]


@contextmanager
def started(workers: int) -> Iterator[Run]:
    with worker_pool(workers) as mine:
        yield mine.posed(posed).run


def who(seconds: float = 0.1) -> int:
    time.sleep(seconds)
    return os.getpid()


def die_unless(here: int) -> int:
    if os.getpid() != here:
        os.kill(os.getpid(), signal.SIGKILL)
    return who()


def refuse_unless(here: int) -> int:
    if os.getpid() != here:
        raise MeasurementError("a fit that fails in a helper")
    return who()


def refuse() -> int:
    raise MeasurementError("field: no fit can bear it; mend it")


def shared(run: Run) -> set[int]:
    """Do jobs until two processes have shared them: as long as a helper takes to start."""
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline:
        found = set(run([Job(f"job {k}", who) for k in range(4)]))
        if len(found) == 2:
            return found
    raise AssertionError("no helper took a job within a minute")


def test_jobs_come_back_in_their_order_and_processes_share_them() -> None:
    with started(2) as run:
        assert os.getpid() in shared(run)
        assert run([Job("", partial(pow, 2, k)) for k in range(20)]) == [2**k for k in range(20)]
    with started(1) as run:
        assert set(run([Job("", who)] * 3)) == {os.getpid()}


def test_results_of_a_helper_hold_the_problem_and_the_effects_of_the_process_that_asked() -> None:
    with worker_pool(2) as processes:
        mine = processes.posed(posed)
        base_model = mine.model
        base = fit(ExtendedModel(base_model), base_model.start)
        model = ExtendedModel(base_model, (SLOPE,))
        alone = fit(model, model.pack({"level": 0.0}, [{"strength": 0.1}]), near=base)
        shared(mine.run)
        found = mine.run(
            [Job("fit", partial(fit, model, alone.vector * 0, near=base)) for _ in range(50)]
        )
    assert len({id(result.vector) for result in found}) == 50
    for result in found:
        assert isinstance(result, FitResult)
        assert result.model.base_model is base_model
        assert result.model.effects[0] is SLOPE
        assert np.array_equal(result.vector, found[0].vector)
        assert np.array_equal(result.jacobian, found[0].jacobian)
        assert np.allclose(result.vector, alone.vector, rtol=1e-6)


class Elsewhere(Level):
    """A model that no other process knows."""

    def __reduce__(self) -> str:
        raise AssertionError("a model of another noise is sent")


def test_fits_that_are_made_again_under_another_noise_are_sent_by_name() -> None:
    known, effects = posed()
    assert isinstance(known, Level)
    other = Elsewhere(known.data, BLOCKS, 100.0)
    base = fit(ExtendedModel(other), other.start)
    one = ExtendedModel(other, (SLOPE,))
    sloped = fit(one, one.pack({"level": 0.0}, [{"strength": 0.1}]), near=base)
    earlier = [criticise(result, effects) for result in (base, sloped)]
    names = ByName(known, effects, None)

    def sent(jobs: Sequence[Job[Any]]) -> list[Any]:
        return [names.unpacked(names.packed(job.find))() for job in jobs]

    _, again = refitted(known, effects, earlier, sent)
    assert again.names == ("slope",)
    assert again.result.model.base_model is known
    assert np.allclose(again.result.vector, sloped.vector, rtol=1e-6)


def test_an_error_in_what_is_sent_is_raised_here() -> None:
    with started(2) as run:
        shared(run)
        with pytest.raises(AttributeError, match="pickle"):
            run([Job("", lambda: who(0.2))] * 6)


def test_fits_of_a_helper_are_kept_in_the_checkpoint(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    with remembered("a file") as checkpoint, worker_pool(2, checkpoint) as processes:
        mine = processes.posed(posed)
        model = ExtendedModel(mine.model, (SLOPE,))
        starts = [model.pack({"level": 0.0}, [{"strength": 0.1 * k}]) for k in range(40)]
        shared(mine.run)
        mine.run([Job("fit", partial(slowly, model, start, checkpoint)) for start in starts])
        (kept,) = (tmp_path / "femnl").glob("diagnosis-*.jsonl")
        assert len(kept.read_text(encoding="utf-8").splitlines()) == len(starts)


def slowly(model: ExtendedModel, start: Array, checkpoint: Checkpoint) -> int:
    fit(model, start, checkpoint=checkpoint)
    return who(0.02)


@pytest.mark.parametrize("end", [die_unless, refuse_unless])
def test_a_helper_that_ends_costs_nothing(
    end: Callable[[int], int], caplog: pytest.LogCaptureFixture
) -> None:
    here = os.getpid()
    with started(2) as run:
        shared(run)
        assert run([Job("", partial(end, here))] * 6) == [here] * 6
        assert run([Job("", who)] * 3) == [here] * 3
    assert [record.message for record in caplog.records if record.levelname == "WARNING"] == [
        f"a helper ended (exit code {-9 if end is die_unless else 1}); its fits are made here"
    ]


def test_an_error_that_every_process_meets_is_raised_here() -> None:
    with started(2) as run:
        shared(run)
        with pytest.raises(MeasurementError, match="no fit can bear it"):
            run([Job("", refuse)] * 4)


def split(path: Path) -> Path:
    """Frequencies of a square film that no few causes explain.

    Unequal stress, and each mode off by 0.2 per mille on its own.
    """
    rng = np.random.default_rng(3)
    frequency = (
        1.11e6
        * np.sqrt(ORDERS**2 @ (1 + 1e-3 * np.array([1, -1])))
        * (1 + 2e-4 * rng.standard_normal(len(ORDERS)))
    )
    data = measurement.spectrum(
        frequency, np.full(len(ORDERS), 3.0), [f"{m},{n}" for m, n in ORDERS]
    )
    measurement.write(measurement.bundle({"spectrum": data}, geometry="square-270um"), path)
    return path


def test_a_diagnosis_says_the_same_whatever_the_workers(tmp_path: Path) -> None:
    path = split(tmp_path / "split.nc")
    effects = [library()[name] for name in FEW]
    alone = record(diagnose(path, effects=effects))
    assert alone["verdict"] == "unexplained"
    assert record(diagnose(path, effects=effects, workers=2)) == alone
    with pytest.raises(ParameterError, match="workers: 0 is none"):
        diagnose(path, workers=0)
    local = replace(SLOPE, changes={"operators": lambda system, _: system})
    with pytest.raises(
        ParameterError,
        match="effects: slope is defined where other processes cannot import it; define it in "
        "a module",
    ):
        diagnose(path, effects=[local], workers=2)


@pytest.mark.slow
def test_without_a_cache_a_diagnosis_is_made_all_the_same_and_each_warning_comes_once(
    tmp_path: Path,
) -> None:
    drive = np.linspace(0, 5, 24)
    noise = np.random.default_rng(1).standard_normal(24)
    softened = measurement.series(
        {"drive": drive}, 1.1e6 * (1 - 2e-6 * drive**2) + noise, np.ones(24)
    )
    path = tmp_path / "softened.nc"
    measurement.write(measurement.bundle({"f": softened}, geometry="square-270um"), path)
    cache = tmp_path / "cache"
    cache.mkdir()
    (cache / "femnl").write_text("in the place of the folder", encoding="utf-8")
    environment = os.environ | {
        "XDG_CACHE_HOME": str(cache),
        "PYTHONPATH": str(Path(__file__).parents[2]),
    }
    command = [
        sys.executable,
        "-m",
        "femnl",
        "diagnose",
        path.name,
        "--workers",
        "2",
        "--out",
        "page",
    ]
    done = subprocess.run(
        command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "page" / "diagnosis.json").is_file()
    lines = [line for line in done.stderr.splitlines() if "not kept" in line]
    assert all(line.startswith("femnl: ") for line in lines), "a helper says it, too"
    assert sum("fits are not kept" in line for line in lines) == 1


def test_an_interrupt_ends_helpers_and_the_fits_are_kept(tmp_path: Path, own_cache: Path) -> None:
    path = split(tmp_path / "split.nc")
    told = own_cache / "femnl"
    environment = os.environ | {
        "XDG_CACHE_HOME": str(own_cache),
        "PYTHONPATH": str(Path(__file__).parents[2]),
    }
    command = [sys.executable, "-m", "femnl", "diagnose", path.name, "--workers", "2"]
    client = subprocess.Popen(
        command, cwd=tmp_path, env=environment, stderr=subprocess.PIPE, text=True
    )
    deadline = time.monotonic() + 120
    children = list[psutil.Process]()
    while not children and client.poll() is None and time.monotonic() < deadline:
        time.sleep(0.01)
        if list(told.glob("diagnosis-*.jsonl")):
            children = psutil.Process(client.pid).children(recursive=True)
    time.sleep(0.5)
    client.send_signal(signal.SIGINT)
    _, errors = client.communicate(timeout=60)
    assert children
    assert client.returncode in (130, -signal.SIGINT)
    assert errors.endswith("femnl: interrupted; nothing was left half-written\n")
    assert "Traceback" not in errors
    psutil.wait_procs(children, timeout=30)
    assert not [child for child in children if child.is_running()]
    (kept,) = told.glob("diagnosis-*.jsonl")
    assert kept.read_text(encoding="utf-8")
