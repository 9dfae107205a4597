"""Sweep files say what varies; stores keep what was solved.

Results are the same however they came about.
"""

import csv
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from femnl.core.errors import MissingLibraryError, ParameterError
from femnl.sweep import Sweep, collect, costs, engine, open_store, read_sweep, run, write_tables
from femnl.sweep.point import KEPT, Point, Record, Settings
from femnl.sweep.solve import GEOMETRIC, MODAL, attempt

GEOMETRY = """
name = "tiny"
source = "a test"
[outline]
kind = "square"
side = "100 um"
[holes]
lattice = "square"
pitch = "20 um"
count = [1, 1]
radius = "2 um"
[film]
thickness = "100 nm"
young = "250 GPa"
poisson = 0.23
density = "3000 kg/m^3"
stress = "1 GPa"
[model]
bending = false
"""
PLAIN = GEOMETRY.replace(GEOMETRY[GEOMETRY.index("[holes]") : GEOMETRY.index("[film]")], "")
HEAD = 'geometry = "tiny.toml"\nmodes = 2\nresolution = 0.3\nkeep = ["frequency", "alpha"]\n'


def write(folder: Path, axes: str, geometry: str = PLAIN, head: str = HEAD) -> Path:
    """A sweep file and its geometry."""
    (folder / "tiny.toml").write_text(geometry, encoding="utf-8")
    path = folder / "sweep.toml"
    path.write_text(head + axes, encoding="utf-8")
    return path


def varied(sweep: Sweep, seed: int = 0) -> list[dict[str, object]]:
    return [point.varied for point in sweep.points(seed)]


def here(points: Iterator[Point], settings: Settings) -> Iterator[Record]:
    """Solve in this very process."""
    for point in points:
        yield attempt(point, settings)


def made_up(points: Iterator[Point], settings: Settings) -> Iterator[Record]:
    """Records without solving anything, last points first."""
    for point in reversed(list(points)):
        stress = float(point.tables["film"]["stress"].split()[0])
        results = {
            "label": ["(1,1)", "(2,1)"],
            "frequency": [stress, 2 * stress],
            "frequency_error": [0.1, None],
        }
        results |= {"alpha": [1.0, 2.0], "alpha_error": [0.0, 0.0]}
        yield {
            "key": point.key(settings),
            "varied": point.varied,
            "results": results,
            "seconds": 1.0,
            "memory": 10,
        }


class TestSpec:
    def test_axes_multiply_and_the_values_of_one_axis_go_together(self, tmp_path: Path) -> None:
        axes = (
            '[[axis]]\nfilm.stress = ["1 GPa", "1.1 GPa"]\n[[axis]]\nholes.pitch = ["20 um", '
            '"30 um"]\nholes.count = [[3, '
            "3], [2, 2]]\n"
        )
        points = varied(read_sweep(write(tmp_path, axes, GEOMETRY)))
        together = [
            {"holes.pitch": "20 um", "holes.count": [3, 3]},
            {"holes.pitch": "30 um", "holes.count": [2, 2]},
        ]
        assert points == [
            {"film.stress": stress} | both for stress in ("1 GPa", "1.1 GPa") for both in together
        ]

    @pytest.mark.parametrize(
        ("written", "values"),
        [
            (
                'film.stress = {from = "0.8 GPa", to = "1.2 GPa", points = 3}',
                ["0.8 GPa", "1 GPa", "1.2 GPa"],
            ),
            (
                'film.stress = {from = "1 MPa", to = "100 MPa", points = 3, spacing = "log"}',
                ["1 MPa", "10 MPa", "100 MPa"],
            ),
            ('film.stress = {from = "1 GPa", to = "2 GPa", points = 1}', ["1 GPa"]),
            ("film.poisson = {from = 0, to = 0.3, points = 4}", [0, 0.1, 0.2, 0.3]),
        ],
    )
    def test_ranges_are_written_as_geometry_files_write_values(
        self, written: str, values: list[object], tmp_path: Path
    ) -> None:
        points = varied(read_sweep(write(tmp_path, f"[[axis]]\n{written}\n")))
        assert [next(iter(point.values())) for point in points] == values

    def test_a_point_has_its_own_values_and_the_base_keeps_its_own(self, tmp_path: Path) -> None:
        sweep = read_sweep(write(tmp_path, '[[axis]]\nfilm.stress = ["2 GPa"]\n'))
        assert [point.tables["film"]["stress"] for point in sweep.points(0)] == ["2 GPa"]
        assert sweep.base["film"]["stress"] == "1 GPa"

    def test_places_in_lists_are_counted_from_one(self, tmp_path: Path) -> None:
        triangle = PLAIN.replace(
            'kind = "square"\nside = "100 um"',
            'kind = "polygon"\npoints = [["0 m", "0 m"], ["9 um", "0 m"], ["0 m", "9 um"]]',
        )
        sweep = read_sweep(write(tmp_path, '[[axis]]\noutline.points.2.1 = ["8 um"]\n', triangle))
        assert next(sweep.points(0)).tables["outline"]["points"] == [
            ["0 m", "0 m"],
            ["8 um", "0 m"],
            ["0 m", "9 um"],
        ]

    @pytest.mark.parametrize("method", ["sobol", "halton", "latin-hypercube"])
    def test_a_sample_fills_its_ranges_and_its_seed_repeats_it(
        self, method: str, tmp_path: Path
    ) -> None:
        axes = '[[axis]]\nfilm.stress = {from = "1 GPa", to = "2 GPa"}\n[[axis]]\n'
        axes += 'outline.side = {from = "10 um", to = "1000 um", spacing = "log"}\n'
        sweep = read_sweep(write(tmp_path, f'{axes}[sample]\npoints = 64\nmethod = "{method}"\n'))
        assert varied(sweep, 5) == varied(sweep, 5) != varied(sweep, 6)
        stress, side = (
            np.array([float(str(p[path]).split()[0]) for p in varied(sweep, 5)])
            for path in sweep.paths
        )
        for place in (stress - 1, np.log10(side) / 2 - 0.5):
            # Eight in each of eight parts, were it perfectly even
            assert np.all(np.histogram(place, 8, (0, 1))[0] >= 6)

    @pytest.mark.parametrize("method", ["sobol", "halton"])
    def test_a_longer_sequence_begins_with_the_shorter_one(
        self, method: str, tmp_path: Path
    ) -> None:
        axes = (
            f'[[axis]]\nfilm.stress = {{from = "1 GPa", to = "2 GPa"}}\n[sample]\nmethod = '
            f'"{method}"\npoints = '
        )
        short, long = (varied(read_sweep(write(tmp_path, f"{axes}{n}\n")), 3) for n in (11, 37))
        assert long[:11] == short

    def test_a_name_of_a_device_leaves_its_key_alone_and_a_value_does_not(
        self, tmp_path: Path
    ) -> None:
        sweep = read_sweep(write(tmp_path, '[[axis]]\nfilm.stress = ["2 GPa", "3 GPa"]\n'))
        one, two = sweep.points(0)
        assert one.key(sweep.settings) != two.key(sweep.settings)
        assert one.key(sweep.settings) == Point(one.tables | {"name": "other"}, {}).key(
            sweep.settings
        )
        assert one.key(sweep.settings) != one.key(replace(sweep.settings, modes=3))

    @pytest.mark.parametrize(
        ("axes", "says"),
        [
            (
                '[[axis]]\nfilm.stres = ["1 GPa"]',
                "axis film.stres: the geometry tiny.toml gives no such value; did you mean "
                "film.stress?",
            ),
            (
                '[[axis]]\nfilm.stress = ["1 um"]',
                'axis film.stress: [film] stress = "1 um": expected a pressure, write e.g. '
                '"250 GPa"',
            ),
            ("[[axis]]\nfilm.stress = [1e9]", "expected a pressure with its unit, in quotes"),
            (
                '[[axis]]\noutline.side = {from = "-1 um", to = "1 um", points = 3}',
                '[outline] side = "-1 um": expected a length that is positive',
            ),
            (
                '[[axis]]\noutline.side = {from = "1 um", to = "1 mm", points = 3}',
                'from is in "um" and to in "mm"; write both in one unit',
            ),
            (
                "[[axis]]\n"
                'outline.side = {from = "0 um", to = "1 um", points = 3, spacing = "log"}',
                "even ratios need two positive ends",
            ),
            (
                '[[axis]]\noutline.side = {from = "1 um", to = "2 um"}',
                "its range gives no points; write points = 5, or sample",
            ),
            (
                '[[axis]]\noutline.side = {from = "1 um", to = "2 um", points = 0}',
                "points = 0: expected a whole number from 1",
            ),
            (
                '[[axis]]\noutline.side = {from = "1 um", to = "2 um", step = 3}',
                "step: unknown key, a range has from, to, points and spacing",
            ),
            ('[[axis]]\noutline.side = {from = "1 um"}', "to is missing; a range has both ends"),
            ('[[axis]]\noutline.side = "1 um"', "expected a list of values, or {from"),
            (
                '[[axis]]\nfilm.stress = ["1 GPa"]\n[[axis]]\nfilm.stress = ["2 GPa"]',
                "two axes vary it",
            ),
            (
                '[[axis]]\nfilm.stress = ["1 GPa"]\noutline.side = ["1 um", "2 um"]',
                "2 values beside 1 of film.stress, with which it varies",
            ),
            ('[[axis]]\noutline.side = ["1 um"]\n[sample]\npoints = 3', "a sample needs ranges"),
            (
                '[[axis]]\noutline.side = ["1 um"]\n[sample]\npoints = 3\npoint = 3',
                "sample.point: unknown key, did you mean points?",
            ),
            ("axis = []", "axis = []: "),
            ("", "axis is missing"),
            ("[[axis]]", "an axis varies something"),
            ("[[axis", "not TOML"),
            (
                'symmetry = "fifth"\n[[axis]]\nfilm.stress = ["1 GPa"]',
                'symmetry = "fifth": expected one of auto',
            ),
        ],
    )
    def test_what_cannot_be_meant_is_one_line(self, axes: str, says: str, tmp_path: Path) -> None:
        with pytest.raises(ParameterError) as caught:
            read_sweep(write(tmp_path, axes))
        assert str(caught.value).startswith(f"{tmp_path / 'sweep.toml'}: ")
        assert says in str(caught.value)
        assert "\n" not in str(caught.value)

    def test_a_billion_points_are_refused_with_what_they_would_take(self, tmp_path: Path) -> None:
        ranges = '{from = "1 um", to = "2 um", points = 31623}'
        axes = (
            f"[[axis]]\noutline.side = {ranges}\n[[axis]]\nfilm.stress = "
            f"{ranges.replace('um', 'GPa')}\n"
        )
        with pytest.raises(
            ParameterError,
            match=r"outline.side × film.stress: 1,000,014,129 points would take at least 6.3 "
            r"years .* GiB",
        ):
            read_sweep(write(tmp_path, axes))

    def test_values_that_are_wrong_in_company_only_are_no_fault_of_the_sweep(
        self, tmp_path: Path
    ) -> None:
        axes = '[[axis]]\nholes.pitch = ["2 um"]\n[[axis]]\nholes.radius = ["0.5 um", "1.5 um"]\n'
        sweep = read_sweep(write(tmp_path, axes, GEOMETRY.replace("[1, 1]", "[2, 2]")))
        bad = attempt(list(sweep.points(0))[1], sweep.settings)
        assert "holes overlap" in bad["error"]


STRESSES = '[[axis]]\nfilm.stress = ["1 GPa", "2 GPa", "3 GPa"]\n'


class TestStore:
    def test_the_frequency_of_an_ideal_membrane_follows_its_stress(self, tmp_path: Path) -> None:
        sweep = read_sweep(write(tmp_path, '[[axis]]\nfilm.stress = ["1 GPa", "4 GPa"]\n'))
        with open_store(tmp_path / "s.jsonl", sweep.settings, None, False) as store:
            run(sweep, store, here, lambda record: None)
            data = collect(sweep, store)
        speed = np.sqrt(np.array([1e9, 4e9]) / 3000)
        np.testing.assert_allclose(
            data.frequency.values, np.outer(speed / 2e-4, np.sqrt([2, 5])), rtol=1e-5
        )
        np.testing.assert_array_equal(data["film.stress"].values, [1e9, 4e9])
        assert data.frequency.attrs["units"] == "Hz"
        assert np.all(
            np.abs(data.frequency - np.outer(speed / 2e-4, np.sqrt([2, 5]))) < data.frequency_error
        )

    def test_tables_are_the_same_bytes_whatever_the_order_of_work(self, tmp_path: Path) -> None:
        sweep = read_sweep(write(tmp_path, STRESSES))
        made = []
        for name, solve in (
            ("one", made_up),
            ("two", lambda points, settings: iter(list(made_up(points, settings))[::-1])),
        ):
            with open_store(tmp_path / f"{name}.jsonl", sweep.settings, None, False) as store:
                run(sweep, store, solve, lambda record: None)
                made.append([path.read_bytes() for path in write_tables(store.path, sweep, store)])
        assert made[0] == made[1]
        with xr.open_dataset(tmp_path / "one.nc", engine="h5netcdf") as data:
            assert data.frequency.values.tolist() == [[1, 2], [2, 4], [3, 6]]
            assert np.all(np.isinf(data.frequency_error.values[:, 1]))
        rows = list(csv.DictReader((tmp_path / "one.csv").read_text(encoding="utf-8").splitlines()))
        assert [
            (row["film.stress (Pa)"], row["label_2"], row["frequency_2 (Hz)"]) for row in rows
        ] == [
            ("1000000000.0", "(2,1)", "2.0"),
            ("2000000000.0", "(2,1)", "4.0"),
            ("3000000000.0", "(2,1)", "6.0"),
        ]

    def test_what_is_known_is_not_solved_again_and_a_larger_sweep_adds_to_it(
        self, tmp_path: Path
    ) -> None:
        seen: list[Record] = []
        for axes, new in (
            (STRESSES, 3),
            (STRESSES, 0),
            (STRESSES.replace('"1 GPa"', '"4 GPa", "4 GPa", "1 GPa"'), 1),
        ):
            sweep = read_sweep(write(tmp_path, axes))
            with open_store(tmp_path / "s.jsonl", sweep.settings, None, False) as store:
                before = len(seen)
                run(sweep, store, made_up, seen.append)
                assert len(seen) - before == new
                assert collect(sweep, store).sizes["point"] == sweep.count
        assert len({record["key"] for record in seen}) == 4

    @pytest.mark.parametrize("cut", [1, 40, 10_000])
    def test_a_line_that_a_crash_cut_off_costs_its_own_point_only(
        self, cut: int, tmp_path: Path
    ) -> None:
        sweep = read_sweep(write(tmp_path, STRESSES))
        path = tmp_path / "s.jsonl"
        seen = list[Record]()
        with open_store(path, sweep.settings, None, False) as store:
            run(sweep, store, made_up, lambda record: None)
        whole = path.read_bytes()
        last = whole.splitlines(keepends=True)[-1]
        path.write_bytes(whole[: -min(cut, len(last) - 1)])
        with open_store(path, sweep.settings, None, False) as store:
            run(sweep, store, made_up, seen.append)
        assert len(seen) == 1
        assert path.read_bytes() == whole
        path.write_bytes(whole + last[:30] + b"x" * 10_000)
        with open_store(path, sweep.settings, None, False):
            assert path.read_bytes() == whole

    def test_a_damaged_line_is_set_aside_and_its_point_solved_anew(
        self, tmp_path: Path, caplog: pytest.LogCaptureFixture
    ) -> None:
        sweep = read_sweep(write(tmp_path, STRESSES))
        path = tmp_path / "s.jsonl"
        with open_store(path, sweep.settings, None, False) as store:
            run(sweep, store, made_up, lambda record: None)
        lines = path.read_bytes().splitlines(keepends=True)
        changed = lines[2].replace(b'"seconds": ', b'"seconds": -')
        path.write_bytes(b"".join([*lines[:2], changed, *lines[3:]]))
        seen: list[Record] = []
        with open_store(path, sweep.settings, None, False) as store:
            run(sweep, store, made_up, seen.append)
        assert [record["key"] for record in seen] == [json.loads(lines[2])["key"]]
        assert "s.jsonl: line 3 is damaged and set aside in " in caplog.text
        assert path.with_name("s.jsonl.damaged").read_bytes() == changed
        assert sorted(path.read_bytes().splitlines(keepends=True)) == sorted(lines)

    @pytest.mark.parametrize("content", ["", "{}\n", "words\n", '{"femnl_sweep": 1'])
    def test_a_file_of_another_kind_is_left_alone(self, content: str, tmp_path: Path) -> None:
        path = tmp_path / "s.jsonl"
        path.write_text(content)
        with (
            pytest.raises(ParameterError, match="no store of a sweep"),
            open_store(path, Settings(), None, False),
        ):
            pass
        assert path.read_text() == content

    def test_other_settings_are_refused_by_name(self, tmp_path: Path) -> None:
        path = tmp_path / "s.jsonl"
        with open_store(path, Settings(modes=4), None, False):
            pass
        with (
            pytest.raises(ParameterError, match="was solved with modes = 4 and not 5"),
            open_store(path, Settings(modes=5), None, False),
        ):
            pass
        path.write_text(path.read_text().replace('"femnl_sweep": 1', '"femnl_sweep": 0'))
        with (
            pytest.raises(ParameterError, match="solved by version 0"),
            open_store(path, Settings(modes=4), None, False),
        ):
            pass

    def test_a_seed_that_nobody_gave_is_kept(self, tmp_path: Path) -> None:
        seeds = []
        for given in (None, None, 7):
            with open_store(tmp_path / "s.jsonl", Settings(), given, False) as store:
                seeds.append(store.seed)
        assert seeds[0] == seeds[1] != 7 == seeds[2]

    def test_two_clients_never_write_to_one_store(self, tmp_path: Path) -> None:
        path = tmp_path / "s.jsonl"
        program = (
            "from pathlib import Path\nfrom femnl.sweep.store import open_store, Settings\n"
            f"with open_store(Path({str(path)!r}), Settings(), None, False): print('open', "
            "flush=True); input()"
        )
        environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])}
        other = subprocess.Popen(
            [sys.executable, "-c", program],
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        )
        assert other.stdout is not None
        assert other.stdout.readline() == b"open\n"
        with (
            pytest.raises(ParameterError, match="another sweep is writing"),
            open_store(path, Settings(), None, False),
        ):
            pass
        other.kill()
        other.communicate()
        with open_store(path, Settings(), None, False):
            pass

    def test_failures_are_kept_with_their_reason_and_tried_again_when_asked(
        self, tmp_path: Path
    ) -> None:
        # A pitch of 60 um puts the four holes 30 um from the axes, a radius of 35 um beyond each
        # other.
        axes = '[[axis]]\nholes.radius = ["2 um", "35 um", "25 um"]\n'
        sweep = read_sweep(
            write(tmp_path, axes, GEOMETRY.replace("20 um", "60 um").replace("[1, 1]", "[2, 2]"))
        )
        path = tmp_path / "s.jsonl"
        seen = list[Record]()
        for retry, new in ((False, 3), (False, 0), (True, 2)):
            with open_store(path, sweep.settings, None, retry) as store:
                before = len(seen)
                run(sweep, store, here, seen.append)
                assert len(seen) - before == new
                report = costs(sweep, store)
                data = collect(sweep, store)
        assert (report.points, report.solved, report.missing) == (3, 1, 0)
        assert sorted(report.failed.values()) == [1, 1]
        assert [bool(reason) for reason in data.error.values] == [False, True, True]
        assert "pitch must exceed twice their radius" in data.error.values[1]
        assert "cuts the outline" in data.error.values[2]
        assert np.isnan(data.frequency.values).all(axis=1).tolist() == [False, True, True]
        keys = [json.loads(line)["key"] for line in path.read_text().splitlines()[1:]]
        assert len(keys) == len(set(keys)) == 3


def test_everything_that_can_be_kept_is_solved_by_one_function() -> None:
    assert [*KEPT] == [*MODAL, *GEOMETRIC]


def test_dask_is_named_where_it_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    monkeypatch.delitem(sys.modules, "femnl.core.cluster", raising=False)
    with pytest.raises(
        MissingLibraryError,
        match=r"needs distributed, which is not installed; pip install 'femnl\[dask\]'",
    ):
        engine("tcp://127.0.0.1:1", 1)


def test_sweeps_never_load_dask_unless_asked() -> None:
    program = "import sys, femnl.sweep, femnl.cli.sweep; sys.exit('distributed' in sys.modules)"
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])}
    assert (
        subprocess.run([sys.executable, "-c", program], env=environment, check=False).returncode
        == 0
    )
