"""What is too large for a command is refused by its declared size, before it is read."""

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from femnl import pipeline
from femnl.cli._main import run
from femnl.cli.diagnose import MOST, _workers_that_fit
from femnl.core.errors import FemnlError, MeasurementError, ParameterError
from femnl.core.kinds import Cost, Size, kinds
from femnl.io import measurement
from femnl.io.measurement import files, sizes
from femnl.io.measurement.sizes import OWN, Use, cost, need_room, need_room_for

Allow = Callable[[int], None]
N = 2000
"""Numbers along each file."""
LINE = np.arange(1.0, N + 1)
NOISE = np.random.default_rng(1).normal(size=N)
GROUPS: Mapping[str, xr.Dataset] = {
    "decay": measurement.decay(LINE, -LINE / 100 + NOISE, attributes={"frequency": 1e6}),
    "map": measurement.harmonic_map(
        [1e-6, 2e-6], LINE * 1e-8, [1], np.add(NOISE.reshape(1, N, 1), [1, 2])
    ),
    "record": measurement.trace(LINE, NOISE, drive_voltage=NOISE),
    "response": measurement.response(1e6 + LINE[None], NOISE[None] + 1j),
    "series": measurement.series({"pressure": LINE}, quality_factor=1e5 + LINE),
    "spectrum": measurement.spectrum(1e6 + LINE, np.ones(N)),
    "trace": measurement.trace(LINE, NOISE, drive_frequency=[0.1], wavelength=632.8e-9),
}
USES: tuple[Use, ...] = ("show", "fit", "diagnose")


@pytest.fixture(params=GROUPS)
def kind(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """Each kind, with a file of it in the folder of the test."""
    monkeypatch.chdir(tmp_path)
    tree = measurement.bundle({"data": GROUPS[request.param]}, geometry="circle")
    measurement.write(tree, "f.nc")
    return str(request.param)


def test_every_kind_states_a_size_and_has_a_file_here() -> None:
    assert GROUPS.keys() == kinds().keys()
    for spec in kinds().values():
        assert spec.size != Size(), spec.name


@pytest.mark.parametrize("use", USES)
def test_a_file_beyond_the_memory_is_refused_before_its_arrays_are_read(
    kind: str,
    use: Use,
    allow_memory: Allow,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(files, "check", None)  # which nothing calls
    monkeypatch.setattr(sizes, "cost", lambda spec, use: Cost(cost(spec, use).memory))
    allow_memory(OWN)
    extra = ["--workers", "1"] if use == "diagnose" else []
    assert run([use, "f.nc", *extra]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("femnl: f.nc: data: ")
    assert f"numbers in {sizes.WORDS[use]} need about 0." in line
    assert "GiB of memory, and this process may take 0.5 GiB; " in line
    assert line.endswith(kinds()[kind].size.remedy)


@pytest.mark.parametrize("use", USES)
def test_what_fits_is_let_through(kind: str, use: Use, allow_memory: Allow) -> None:
    numbers = 8 * sum(variable.size for variable in GROUPS[kind].variables.values())
    spec = kinds()[kind]
    most = cost(spec, use).most
    if most is not None and most < N:
        with pytest.raises(MeasurementError, match=f"holds 2,000 {spec.size.data}, and "):
            need_room(Path("f.nc"), use)
        return
    allow_memory(OWN + int((cost(spec, use).memory + 1) * numbers) + 1000)
    need_room(Path("f.nc"), use)
    need_room_for(measurement.read("f.nc"), "f.nc", use)


def test_more_data_than_a_command_ends_with_are_refused(
    kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    largest = max(variable.size for variable in GROUPS[kind].variables.values())
    monkeypatch.setattr(sizes, "cost", lambda *_: Cost(1.0, largest))
    need_room(Path("f.nc"), "fit")
    monkeypatch.setattr(sizes, "cost", lambda *_: Cost(1.0, largest - 1))
    told = rf"^f\.nc: data: holds {largest:,} .*, and a fit of a {kind} takes at most "
    with pytest.raises(MeasurementError, match=told):
        need_room(Path("f.nc"), "fit")
    with pytest.raises(MeasurementError, match=told):
        need_room_for(measurement.read("f.nc"), "f.nc", "fit")


def test_workers_hold_the_data_each(
    tmp_path: Path, allow_memory: Allow, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    measurement.write(measurement.bundle({"data": GROUPS["series"]}), "f.nc")
    allow_memory(3 * OWN)
    need_room(Path("f.nc"), "diagnose", workers=2)
    with pytest.raises(ParameterError, match=r"; lower --workers, or average neighbouring points$"):
        need_room(Path("f.nc"), "diagnose", workers=4)


@pytest.mark.parametrize(("use", "fits"), [("fit", True), ("diagnose", False)])
def test_a_fit_takes_one_group_after_the_other_and_a_diagnosis_all(
    use: Use, fits: bool, tmp_path: Path, allow_memory: Allow, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    groups = {f"d{k}": GROUPS["decay"] for k in range(40)}
    measurement.write(measurement.bundle(groups), "f.nc")
    monkeypatch.setattr(sizes, "cost", lambda *_: Cost(1000.0))
    allow_memory(OWN + 1100 * 2 * 8 * N)
    if fits:
        need_room(Path("f.nc"), use)
    else:
        with pytest.raises(FemnlError, match=r"need about"):
            need_room(Path("f.nc"), use)


def test_a_lab_file_is_refused_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    rows = "\n".join(f"{p},{1e5 - p}" for p in range(1, 40))
    Path("f.csv").write_text(f"p,Q\n{rows}\n", encoding="utf-8")
    spec = 'kind = "series"\n[columns]\npressure = { column = "p", unit = "Pa" }\n'
    Path("f.toml").write_text(spec + 'quality_factor = "Q"\n', encoding="utf-8")
    monkeypatch.setattr(sizes, "cost", lambda *_: Cost(1.0, 10))
    assert run(["fit", "f.csv"]) == 2
    (line,) = (text for text in capsys.readouterr().err.splitlines() if text.startswith("femnl: "))
    assert "holds 39 points, and a fit of a series takes at most 10; average" in line


def test_maps_beyond_the_memory_are_refused_before_modes_are_solved(
    allow_memory: Allow, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(pipeline, "solve_modes", None)  # which nothing calls
    allow_memory(2**33)
    assert run(["maps", "circle", "--z", "4", "--points", "2001", "--harmonics", "50"]) == 2
    assert capsys.readouterr().err == (
        "femnl: maps of 2001 × 2001 points and 50 harmonics need about 27 GiB of memory, and this "
        "process may take 8 GiB; lower --points or --harmonics\n"
    )


def test_fewer_workers_are_started_where_the_memory_is_short(
    tmp_path: Path,
    allow_memory: Allow,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("os.sched_getaffinity", lambda _: range(8))
    measurement.write(measurement.bundle({"data": GROUPS["series"]}), "f.nc")
    assert _workers_that_fit(Path("f.nc")) == MOST
    assert capsys.readouterr().err == ""
    allow_memory(3 * OWN)
    assert _workers_that_fit(Path("f.nc")) == 2
    assert capsys.readouterr().err.startswith("2 workers of 4, as each holds the data")
    allow_memory(OWN)
    assert _workers_that_fit(Path("f.nc")) == 1


def test_the_page_of_limits_has_those_of_every_kind() -> None:
    page = (Path(__file__).parents[2] / "docs" / "reference" / "limits.md").read_text("utf-8")
    for name, spec in kinds().items():
        costs = [cost(spec, use) for use in USES]
        told = [f"{c.memory:g}" + ("" if c.most is None else f", {c.most:,}") for c in costs]
        assert f"| `{name}` | {spec.size.data} | {' | '.join(told)} |" in page
