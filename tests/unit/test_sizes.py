"""What is too large for a command is refused by its declared size, before it is read."""

from collections.abc import Callable, Mapping
from contextlib import suppress
from cProfile import Profile
from pathlib import Path
from pstats import Stats

import h5py
import numpy as np
import pytest
import xarray as xr

from femnl import pipeline
from femnl.cli._main import run
from femnl.cli.diagnose import MOST, _workers_that_fit
from femnl.core.errors import FemnlError, MeasurementError, ParameterError
from femnl.core.kinds import Size, kinds
from femnl.io import measurement
from femnl.io.measurement import sizes
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


def without_numbers(path: str) -> None:
    """Leave in a file what it declares, and no number of a group."""
    with h5py.File(path, "r+") as file:
        for item in file["data"].values():
            if isinstance(item, h5py.Dataset):
                item[...] = np.full(item.shape, np.nan)


def store(path: str, count: int) -> None:
    """Let the largest datasets of a file be of a length."""
    with h5py.File(path, "r+") as file:
        group = file["data"]
        sizes_of = {name: int(np.prod(item.shape)) for name, item in group.items()}
        largest = max(sizes_of.values())
        for name in (name for name, size in sizes_of.items() if size == largest):
            attributes = dict(group[name].attrs)
            del group[name]
            group.create_dataset(name, data=np.zeros(count)).attrs.update(attributes)


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
    capsys: pytest.CaptureFixture[str],
) -> None:
    spec = kinds()[kind]
    without_numbers("f.nc")  # a file that is read is refused for what it holds
    allow_memory(OWN)
    extra = ["--workers", "1"] if use == "diagnose" else []
    assert run([use, "f.nc", *extra]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("femnl: f.nc: data: ")
    if (cost(spec, use).most or N) < N:
        assert f"holds 2,000 {spec.size.data}, and " in line
        return
    assert f"numbers in {sizes.WORDS[use]} need about 0." in line
    assert "GiB of memory, and this process may take 0.5 GiB; " in line
    assert line.endswith(spec.size.remedy)


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


def test_more_data_than_a_diagnosis_ends_with_are_refused(kind: str) -> None:
    most = cost(kinds()[kind], "diagnose").most
    assert most is not None
    store("f.nc", most)
    with suppress(ParameterError):  # for the memory of this machine, which is asked for later
        need_room(Path("f.nc"), "diagnose")
    store("f.nc", most + 1)
    told = rf"^f\.nc: data: holds {most + 1:,} .*, and a diagnosis of a {kind} takes at most "
    with pytest.raises(MeasurementError, match=told):
        need_room(Path("f.nc"), "diagnose")


def test_lines_that_were_read_are_refused_alike() -> None:
    most = cost(kinds()["spectrum"], "diagnose").most
    assert most is not None
    few, many = (
        measurement.bundle({"data": measurement.spectrum(1e6 + LINE[:count], np.ones(count))})
        for count in (most, most + 1)
    )
    need_room_for(few, "f.nc", "diagnose")
    with pytest.raises(MeasurementError, match=r"^f\.nc: data: holds 161 lines, and a diagnosis "):
        need_room_for(many, "f.nc", "diagnose")


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
    numbers = 8 * sum(variable.size for variable in GROUPS["decay"].variables.values())
    one = (cost(kinds()["decay"], use).memory + len(groups)) * numbers
    allow_memory(OWN + int(1.1 * one))
    if fits:
        need_room(Path("f.nc"), use)
    else:
        with pytest.raises(FemnlError, match=r"need about"):
            need_room(Path("f.nc"), use)


def test_a_lab_file_is_refused_too(
    tmp_path: Path,
    allow_memory: Allow,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    rows = "\n".join(f"{p},{1e5 - p}" for p in range(1, 40))
    Path("f.csv").write_text(f"p,Q\n{rows}\n", encoding="utf-8")
    spec = 'kind = "series"\n[columns]\npressure = { column = "p", unit = "Pa" }\n'
    Path("f.toml").write_text(spec + 'quality_factor = "Q"\n', encoding="utf-8")
    allow_memory(OWN)
    assert run(["fit", "f.csv"]) == 2
    (line,) = (text for text in capsys.readouterr().err.splitlines() if text.startswith("femnl: "))
    assert ": 78 numbers in a fit need about 0.5 GiB of memory, and this process may take" in line


def test_maps_beyond_the_memory_are_refused_before_modes_are_solved(
    allow_memory: Allow, capsys: pytest.CaptureFixture[str]
) -> None:
    allow_memory(2**33)
    with Profile() as profile:
        assert run(["maps", "circle", "--z", "4", "--points", "2001", "--harmonics", "50"]) == 2
    called = Stats(profile).get_stats_profile().func_profiles
    assert run.__name__ in called
    assert pipeline.solve_modes.__name__ not in called
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
