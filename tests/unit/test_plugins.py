"""Effects and lab formats of others: the package of docs/howto/plugins.md, and folders."""

import json
import os
import pickle
import subprocess
import sys
import time
import tomllib
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from zipfile import ZipFile

import numpy as np
import pytest

from femnl.core.effect import Effect
from femnl.core.errors import ParameterError
from femnl.core.readout import Array
from femnl.diagnose import diagnose
from femnl.diagnose.posing import Posing
from femnl.diagnose.sent import sent
from femnl.diagnose.worker_pool import Job, Posed, worker_pool
from femnl.effects import fingerprint, from_folder, library
from femnl.fits.least_squares import fit
from femnl.io import measurement
from femnl.observe.extended import ExtendedModel
from femnl.observe.noisy import FoundNoise, NoisyModel
from tests.unit.plugin_page import CAUSE, EFFECT, FILES, PAGE, forget

ROOT = Path(__file__).parents[2]
SOFTENING = 2e-6
DRIVE = np.linspace(0, 5, 24)
FREQUENCY = 1.1e6 * (1 - SOFTENING * DRIVE**2) + np.random.default_rng(1).normal(size=24)
pytestmark = pytest.mark.usefixtures("_own_plug_ins")


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build the package of the page, and return the folder that it is installed in."""
    source = tmp_path_factory.mktemp("source")
    (source / "our_lab").mkdir()
    for name in ("pyproject.toml", "our_lab/__init__.py", "our_lab/analyser.py"):
        (source / name).write_text(FILES[name], encoding="utf-8")
    (source / "our_lab" / "softening.py").write_text(EFFECT, encoding="utf-8")
    build = [sys.executable, "-m", "hatchling", "build", "--target", "wheel"]
    subprocess.run(build, cwd=source, check=True, capture_output=True)
    (wheel,) = (source / "dist").glob("*.whl")
    folder = tmp_path_factory.mktemp("site")
    ZipFile(wheel).extractall(folder)
    return folder


@pytest.fixture
def series(tmp_path: Path) -> Path:
    """A measurement file of a resonance that the drive softens."""
    data = measurement.series({"drive": DRIVE}, FREQUENCY, np.ones(24))
    path = tmp_path / "drive.nc"
    measurement.write(measurement.bundle({"f": data}, geometry="square-270um"), path)
    return path


def femnl(site: Path, folder: Path, *words: str) -> str:
    """Run femnl in a process of its own with what is installed in a site; its output."""
    environment = os.environ | {"PYTHONPATH": f"{ROOT}{os.pathsep}{site}"}
    done = subprocess.run(
        [sys.executable, "-m", "femnl", *words],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_effect_of_an_installed_package_is_listed(site: Path, tmp_path: Path) -> None:
    listed = json.loads(femnl(site, tmp_path, "effects", "--json"))["effects"]
    (ours,) = [effect for effect in listed if effect["name"] == CAUSE]
    assert ours["kinds"] == ["series"]
    assert len(listed) == len(library()) + 1


@pytest.mark.slow
def test_a_package_reads_its_file_and_names_its_cause_on_any_number_of_workers(
    site: Path, tmp_path: Path
) -> None:
    rows = np.column_stack([DRIVE, 1e-3 * FREQUENCY, np.ones(24)])
    np.savetxt(tmp_path / "drive.ana", rows, header="Our Analyser 2", comments="")
    femnl(site, tmp_path, "import", "drive.ana", "drive.nc")
    words = ("diagnose", "drive.nc", "--geometry", "square-270um", "--json", "--workers")
    alone = femnl(site, tmp_path, *words, "1")
    found = json.loads(alone)
    assert (found["verdict"], found["causes"]) == ("explained", [CAUSE])
    softening = found["parameters"][CAUSE]["softening"]
    assert abs(softening["value"] - SOFTENING) < 4 * softening["sd"]
    assert femnl(site, tmp_path, *words, "2") == alone


def test_an_effect_of_a_folder_is_found(series: Path, effects_folder: Path) -> None:
    ours = from_folder(effects_folder)
    assert set(ours) == {CAUSE}
    found = diagnose(series, effects=[*library().values(), *ours.values()])
    assert (found.verdict, found.causes) == ("explained", (CAUSE,))


def test_helpers_fit_an_effect_of_a_folder_as_it_was_read(
    series: Path, effects_folder: Path
) -> None:
    pool = (library() | from_folder(effects_folder)).values()
    (effects_folder / "softening.py").write_text("raise OSError")
    fitted_by_two(Posing(series, None, sent(pool, 2)))


def test_a_file_is_posed_once_whatever_its_noise(series: Path) -> None:
    posing = Posing(series, None, sent(library().values(), 1))
    stated, _ = posing(None)
    noisier, _ = posing(None, noise={"": FoundNoise(factor=2.0)})
    assert isinstance(noisier, NoisyModel)
    assert noisier.bare is stated
    # A process that it is sent to poses the file itself
    elsewhere, _ = pickle.loads(pickle.dumps(posing))(None)
    assert elsewhere is not stated
    assert np.array_equal(elsewhere.start, stated.start)


def test_helpers_fit_an_effect_of_a_package(
    site: Path, series: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(site))
    forget()
    names = sent(library().values(), 2)
    assert CAUSE in names
    fitted_by_two(Posing(series, None, names))


def fitted_by_two(pose: Callable[..., Posed]) -> None:
    """Fit our effect in this process and in a helper, with one outcome."""
    deadline = time.monotonic() + 60
    processes = set[int]()
    vectors = set[bytes]()
    with worker_pool(2) as two:
        mine = two.posed(pose)
        base_model = mine.model
        (ours,) = [effect for effect in mine.effects if effect.name == CAUSE]
        model = ExtendedModel(base_model, (ours,))
        start = model.pack({"frequency": 1.1e6}, [{"softening": 1e-6}])
        while len(processes) < 2 and time.monotonic() < deadline:
            for process, vector in mine.run([Job("fit", partial(fitted, model, start))] * 4):
                processes.add(process)
                vectors.add(vector.tobytes())
    assert os.getpid() in processes
    assert len(processes) == 2, "no helper took a job"
    assert len(vectors) == 1


def fitted(model: ExtendedModel, start: Array) -> tuple[int, Array]:
    """Return the process that fitted, and the parameters that it found."""
    time.sleep(0.1)
    return os.getpid(), fit(model, start).vector


def test_the_command_takes_the_effects_of_a_folder_beside_the_library(
    series: Path, effects_folder: Path
) -> None:
    words = ("diagnose", series.name, "--effects", effects_folder.name, "--json", "--workers")
    alone = femnl(Path(), series.parent, *words, "1")
    assert json.loads(alone)["causes"] == [CAUSE]
    assert femnl(Path(), series.parent, *words, "2") == alone
    listed = json.loads(
        femnl(Path(), series.parent, "effects", "--effects", effects_folder.name, "--json")
    )
    assert [effect["name"] for effect in listed["effects"]] == [*library(), CAUSE]


def test_without_the_effect_nothing_explains_the_data(series: Path) -> None:
    assert diagnose(series).verdict == "unexplained"


def test_an_effect_of_a_folder_that_was_changed_in_python_is_not_that_of_its_file(
    series: Path, effects_folder: Path
) -> None:
    (ours,) = from_folder(effects_folder).values()
    changed = replace(ours, name="other")
    assert diagnose(series, effects=[changed]).causes == ("other",)
    with pytest.raises(ParameterError, match="other is defined where other processes cannot"):
        diagnose(series, effects=[changed], workers=2)


def test_two_effects_of_one_name_are_refused_by_a_diagnosis(
    series: Path, effects_folder: Path
) -> None:
    (ours,) = from_folder(effects_folder).values()
    with pytest.raises(ParameterError, match=f"2 are called '{CAUSE}'"):
        diagnose(series, effects=[ours, ours])


def test_files_that_begin_with_an_underscore_are_left_out(effects_folder: Path) -> None:
    (effects_folder / "_draft.py").write_text("raise OSError")
    assert set(from_folder(effects_folder)) == {CAUSE}


def checkpoint(series: Path, pool: list[Effect], monkeypatch: pytest.MonkeyPatch) -> str:
    """Return the name of the file in which an interrupted diagnosis leaves its fits."""

    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    cache = series.parent / "cache"
    with monkeypatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(cache))
        patch.setattr("femnl.diagnose.run.conclude", interrupted)
        with pytest.raises(KeyboardInterrupt):
            diagnose(series, effects=pool)
    (file,) = (cache / "femnl").glob("diagnosis-*.jsonl")
    file.unlink()
    return file.name


def test_an_effect_file_that_was_changed_never_meets_old_fits(
    series: Path, effects_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = checkpoint(series, list(from_folder(effects_folder).values()), monkeypatch)
    assert checkpoint(series, list(from_folder(effects_folder).values()), monkeypatch) == first
    (effects_folder / "softening.py").write_text(EFFECT.replace("** 2", "** 3"), encoding="utf-8")
    assert checkpoint(series, list(from_folder(effects_folder).values()), monkeypatch) != first


def digest_elsewhere(site: Path) -> str:
    """Return the digest of the library with a site, as a process of its own finds it."""
    script = "from femnl.effects import *; print(fingerprint(library().values()))"
    return subprocess.run(
        [sys.executable, "-c", script],
        env=os.environ | {"PYTHONPATH": f"{ROOT}{os.pathsep}{site}"},
        capture_output=True,
        text=True,
        check=True,
    ).stdout


def test_the_digest_of_the_library_holds_every_file_of_a_package(site: Path) -> None:
    first = digest_elsewhere(site)
    assert digest_elsewhere(site) == first
    helper = site / "our_lab" / "parts" / "helper.py"
    helper.parent.mkdir()
    helper.write_text("FACTOR = 2")
    second = digest_elsewhere(site)
    helper.unlink()
    assert second != first
    assert digest_elsewhere(site) == first


def test_the_digest_of_an_effect_holds_its_numbers() -> None:
    ours = replace(library()["gas_damping"])
    wider = replace(ours, parameters=(replace(ours.parameters[0], high=2.0),))
    assert fingerprint([wider]) == fingerprint([wider]) != fingerprint([ours])


def test_an_effect_without_source_meets_no_old_fits() -> None:
    class Odd:
        def __call__(self, value: object, values: object) -> object:
            return value

    odd = replace(library()["gas_damping"], changes={"points": Odd()})
    assert fingerprint([odd]) != fingerprint([odd])


def test_an_effect_of_a_module_of_ones_own_is_known_by_its_source(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(tmp_path))
    digests = []
    for power in (2, 2, 3):
        (tmp_path / "toy_own.py").write_text(EFFECT.replace("** 2", f"** {power}  # here"))
        monkeypatch.delitem(sys.modules, "toy_own", raising=False)
        digests.append(fingerprint([__import__("toy_own").EFFECT]))
    assert digests[0] == digests[1] != digests[2]


def test_the_page_names_every_file_of_the_package() -> None:
    points = tomllib.loads(FILES["pyproject.toml"])["project"]["entry-points"]
    modules = [module for group in points.values() for module in group.values()]
    assert modules == ["our_lab.softening", "our_lab.analyser"]
    for name in (
        "pyproject.toml",
        "our_lab/__init__.py",
        *(f"{m.replace('.', '/')}.py" for m in modules),
    ):
        assert f"| `{name}` |" in PAGE
