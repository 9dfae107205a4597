"""Results on disk: read back as written, opened by other programs, never half-written."""

import logging
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import meshio
import numpy as np
import pytest
import xarray as xr

from femnl.core.device import Edge, Model
from femnl.core.errors import ParameterError
from femnl.core.modes import Modes
from femnl.core.nonlinearity import Nonlinearity
from femnl.device.mesh import mesh
from femnl.io.results.atomic import write_whole
from femnl.io.results.cache import cached_modes, cached_nonlinearity
from femnl.io.results.netcdf import read_modes, write_modes
from femnl.io.results.surface import unfold
from femnl.io.results.vtu import write_mesh, write_vtu
from femnl.mechanics.modes import shape_at, solve_modes
from femnl.mechanics.nonlinearity import solve_nonlinearity
from femnl.mechanics.prestress import solve_prestress

SQUARE = 'kind = "square"\nside = "100 um"'
HEXAGON = 'kind = "regular-polygon"\nsides = 6\nlong_axis = "100 um"'
HOLES = 'lattice = "list"\nradius = "4 um"\ncentres = [["0 um", "0 um"]]'


def solve(model: Model, symmetry: str = "auto") -> Modes:
    prestress = solve_prestress(mesh(model, symmetry), 3)
    return solve_modes(prestress, 6, 3)


def test_modes_read_back_as_they_were_written(device: Callable[..., Model], tmp_path: Path) -> None:
    model = device(SQUARE, HOLES)
    modes = solve(model)
    write_modes(
        tmp_path / "m.nc",
        replace(modes, coarse=modes),
        solve_nonlinearity(modes, "clamped", tensor=True),
    )
    again = read_modes(tmp_path / "m.nc", model)
    assert again.label == modes.label
    assert again.parity == modes.parity
    np.testing.assert_array_equal(again.shapes, modes.shapes)
    np.testing.assert_array_equal(again.frequency, modes.frequency)
    np.testing.assert_array_equal(
        solve_nonlinearity(again, "clamped").k3, solve_nonlinearity(modes, "clamped").k3
    )
    assert again.coarse is not None
    with xr.open_dataset(tmp_path / "m.nc", group="modes", engine="h5netcdf") as stored:
        assert stored.alpha.attrs["units"] == "m^-2"
        assert stored.tensor.shape == (6, 6, 6, 6)


@pytest.mark.parametrize(
    ("outline", "symmetry", "area"),
    [
        (SQUARE, "quarter", 1e-8),
        (SQUARE, "eighth", 1e-8),
        (SQUARE, "full", 1e-8),
        (HEXAGON, "twelfth", 1.5 * 3**0.5 * 25e-10),
        (HEXAGON, "half", 1.5 * 3**0.5 * 25e-10),
    ],
)
def test_unfolded_film_covers_the_outline_once_with_the_shapes_of_the_modes(
    device: Callable[..., Model], outline: str, symmetry: str, area: float
) -> None:
    modes = solve(device(outline, HOLES), symmetry)
    surface = unfold(modes)
    a, b, c = (surface.points[surface.triangles[:, k]] for k in range(3))
    twice = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    assert twice.min() > 0
    # Chords instead of the arcs of the hole
    assert twice.sum() / 2 == pytest.approx(area - np.pi * 16e-12, rel=1e-3)
    middles = (
        surface.points[surface.triangles[:, [0, 1, 2]]]
        + surface.points[surface.triangles[:, [1, 2, 0]]]
    ) / 2
    # Edges bend only along the hole
    assert np.abs(surface.points[surface.triangles[:, 3:]] - middles).max() < 2e-7
    off_rim = np.hypot(*surface.points.T) > 4.1e-6
    for k in range(3):
        there = surface.points[off_rim] * 0.999999
        np.testing.assert_allclose(
            surface.shapes[k][off_rim], shape_at(modes, k, *there.T), atol=2e-5
        )


def test_relaxed_stress_at_a_hole_carries_no_traction(device: Callable[..., Model]) -> None:
    surface = unfold(solve(device(SQUARE, HOLES)))
    radius = np.hypot(*surface.points.T)
    rim = np.isclose(radius, 4e-6, rtol=1e-4)
    normal = surface.points[rim] / radius[rim, None]
    xx, yy, xy = surface.stress[rim].T
    traction = np.stack(
        [xx * normal[:, 0] + xy * normal[:, 1], xy * normal[:, 0] + yy * normal[:, 1]]
    )
    assert rim.sum() >= 24
    # Of 1 GPa; the stress along the rim is about twice the film's
    assert np.abs(traction).max() < 0.03e9
    assert surface.stress[rim].max() > 1.8e9


def test_vtu_opens_in_meshio_with_every_shape_and_the_stress(
    device: Callable[..., Model], tmp_path: Path
) -> None:
    modes = solve(device(SQUARE))
    write_vtu(tmp_path / "m.vtu", modes)
    stored = meshio.read(tmp_path / "m.vtu")
    assert stored.cells[0].type == "triangle6"
    assert "mode_1_(1,1)" in stored.point_data
    np.testing.assert_allclose(stored.point_data["stress_xx_Pa"], 1e9, rtol=1e-9)


def test_mesh_is_written_in_the_format_its_suffix_names_and_others_are_refused(
    device: Callable[..., Model], tmp_path: Path
) -> None:
    domain = mesh(device(SQUARE))
    write_mesh(tmp_path / "m.vtk", domain)
    assert len(meshio.read(tmp_path / "m.vtk").cells[0].data) == domain.mesh.nelements
    with pytest.raises(
        ParameterError, match=r"m\.docx: meshio writes no files that end in '\.docx'"
    ):
        write_mesh(tmp_path / "m.docx", domain)


def test_a_failing_write_leaves_the_old_file_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "result.nc"
    path.write_text("old")

    def fail(file: Path) -> None:
        file.write_text("half")
        raise OSError(28, "No space left on device")

    with pytest.raises(ParameterError, match="No space left on device"):
        write_whole(path, fail)
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_missing_folder_is_one_clear_line(tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match="cannot write there"):
        write_whole(tmp_path / "none" / "x.nc", lambda file: None)


class TestCache:
    @pytest.fixture(autouse=True)
    def _own_folder(self, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
        monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))

    def test_second_call_reads_what_the_first_solved(self, device: Callable[..., Model]) -> None:
        model = device(SQUARE)
        calls = []

        def count() -> Modes:
            calls.append(1)
            return solve(model)

        first, second = (cached_modes(model, (6,), count) for _ in range(2))
        assert len(calls) == 1
        np.testing.assert_array_equal(first.frequency, second.frequency)

    def test_every_change_of_device_or_options_is_solved_anew(
        self, device: Callable[..., Model]
    ) -> None:
        calls: list[Model] = []

        def solve_and_count(model: Model) -> Modes:
            calls.append(model)
            return solve(model)

        plain = device(SQUARE)
        holed = device(SQUARE, HOLES)
        thicker = replace(plain, film=replace(plain.film, thickness=2e-6))
        for model, options in (
            (plain, (6,)),
            (plain, (7,)),
            (holed, (6,)),
            (thicker, (6,)),
            (replace(plain, bending=True), (6,)),
        ):
            cached_modes(model, options, partial(solve_and_count, model))
        assert len(calls) == 5

    def test_a_damaged_file_is_reported_and_solved_anew(
        self, device: Callable[..., Model], tmp_path: Path, caplog: pytest.LogCaptureFixture
    ) -> None:
        model = device(SQUARE)
        expected = cached_modes(model, (6,), lambda: solve(model)).frequency
        (path,) = (tmp_path / "femnl").glob("*.nc")
        path.write_bytes(path.read_bytes()[:1000])
        with caplog.at_level(logging.WARNING):
            again = cached_modes(model, (6,), lambda: solve(model))
        assert "unreadable in the cache" in caplog.text
        np.testing.assert_allclose(again.frequency, expected, rtol=1e-12)
        caplog.clear()
        cached_modes(model, (6,), lambda: solve(model))
        assert not caplog.text

    @pytest.mark.parametrize("tensor", [False, True])
    def test_nonlinearity_is_kept_for_these_modes_this_edge_and_this_extent_only(
        self, device: Callable[..., Model], tensor: bool
    ) -> None:
        modes = solve(device(SQUARE))
        calls = []

        def count(edge: Edge) -> Nonlinearity:
            calls.append(edge)
            return solve_nonlinearity(modes, edge, tensor)

        first, second = (
            cached_nonlinearity(modes, "clamped", tensor, partial(count, "clamped"))
            for _ in range(2)
        )
        assert calls == ["clamped"]
        np.testing.assert_array_equal(first.alpha, second.alpha)
        assert (second.tensor is not None) == tensor
        sliding = cached_nonlinearity(modes, "sliding", tensor, partial(count, "sliding"))
        assert calls == ["clamped", "sliding"]
        assert sliding.alpha[0] < first.alpha[0]
