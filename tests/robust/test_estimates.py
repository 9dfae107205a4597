"""What a mesh will need is foreseen before it is made, to within a factor that decides nothing."""

import logging
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from femnl.core.device import Model
from femnl.core.errors import ParameterError
from femnl.core.memory import allowed_memory, limits_of_groups, need_memory
from femnl.device.geometry import load, parse
from femnl.device.mesh import build
from femnl.pipeline import solve_modes


@pytest.fixture
def mixed() -> Model:
    """A square with 36 slots, rounded squares and ellipses, as a layout mixes them."""
    shapes = (
        'shape = {kind = "rectangle", width = "6 um", height = "1.5 um", fillet = "0.75 um"}',
        'shape = {kind = "square", side = "3 um", fillet = "0.8 um"}',
        'semi_axes = ["3 um", "1 um"]',
    )
    groups = ""
    for k, shape in enumerate(shapes):
        places = ", ".join(
            f'["{10 * column - 25 + row / 10:.1f} um", "{10 * row - 25} um"]'
            for row in range(6)
            for column in range(6)
            if (row + column) % 3 == k
        )
        groups += f'[[holes]]\nlattice = "list"\ncentres = [{places}]\n{shape}\n'
    film = load("square-270um").text.partition("[film]")[2].partition("[")[0]
    outline = '[outline]\nkind = "square"\nside = "60 um"\n'
    return parse(f'name = "mixed"\nsource = "a test"\n{outline}{groups}[film]{film}')


def test_the_triangles_of_mixed_openings_are_foreseen(
    mixed: Model, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.INFO, "femnl.progress"):
        made = build.mesh(mixed).mesh.nelements
    (foreseen,) = re.findall(r": about (\S+) triangles", caplog.text)
    assert 0.8 < float(foreseen) / made < 1.4


@pytest.mark.parametrize(
    ("name", "symmetry", "resolution"),
    [
        ("circle", "full", 2),
        ("square-270um", "full", 1),
        ("trampoline", "full", 1),
        ("trampoline", "full", 3),
    ],
)
def test_the_number_of_triangles_is_foreseen(
    name: str, symmetry: str, resolution: float, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO, "femnl.progress")
    made = build.mesh(load(name), symmetry, resolution).mesh.nelements
    (foreseen,) = re.findall(r": about (\S+) triangles", caplog.text)
    assert 0.6 < float(foreseen) / made < 1.6


def test_a_degree_that_does_not_fit_is_refused_where_lower_ones_do(
    allow_memory: Callable[[int], None],
) -> None:
    # Of memory a triangle: enough for degree 5, not for 6. Meshes for higher degrees have smaller
    # elements at the corners.
    film = load("hexagon-278um")
    each = np.sqrt(build.BYTES[5] * build.BYTES[6])
    triangles = build.mesh(film, degree=5).mesh.nelements
    allow_memory(int(each * triangles))
    assert build.mesh(film, degree=5).mesh.nelements == triangles
    with pytest.raises(
        ParameterError,
        match=r"^hexagon-278um: modes of degree 6 on .* triangles need about .*; lower the "
        r"resolution$",
    ):
        solve_modes(film, 1, cache=False, degree=6)


def test_a_mesh_alone_needs_its_own_memory_and_none_for_modes(
    allow_memory: Callable[[int], None],
) -> None:
    film = load("square-270um")
    triangles = build.mesh(film, "full").mesh.nelements
    between = int(np.sqrt(build.ALONE * build.BYTES[4]) * triangles)
    allow_memory(between)
    with pytest.raises(ParameterError, match=r"modes of degree 4 on .* triangles need about"):
        build.mesh(film, "full")
    assert build.mesh(film, "full", alone=True).mesh.nelements == triangles
    allow_memory(build.ALONE * triangles // 2)
    with pytest.raises(ParameterError, match=r"^square-270um: \S+ triangles need about"):
        build.mesh(film, "full", alone=True)


def test_what_fits_is_let_through_and_what_does_not_names_size_and_remedy() -> None:
    need_memory(1e6, "ten modes", "ask for fewer")
    with pytest.raises(
        ParameterError,
        match=r"^ten modes need about 90,949 GiB of memory, and this machine has .* GiB; ask "
        r"for fewer$",
    ):
        need_memory(1e5 * 2**30 * 0.909494702, "ten modes", "ask for fewer")


@pytest.mark.parametrize("kind", ["v", "d", "m"])
def test_what_a_shell_allows_counts_as_the_memory_of_the_machine_does(kind: str) -> None:
    words = (
        'from femnl.core.memory import need_memory as n; n(1e9, "ten modes", "ask '
        'for fewer"); n(5e9, "two '
        'films", "ask for one")'
    )
    command = f"ulimit -{kind} 4000000; {sys.executable} -c '{words}'"
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, check=False)
    line = "two films need about 4.7 GiB of memory, and this process may take 3.8 GiB; ask for one"
    assert done.stderr.splitlines()[-1] == f"femnl.core.errors.ParameterError: {line}"


GROUPS = {
    "version 2": (
        "0::/system.slice/job.scope\n",
        {"system.slice/job.scope/memory.max": "3000000000\n"},
        3_000_000_000,
    ),
    "the least of those above": (
        "0::/batch/job\n",
        {"batch/job/memory.max": "max\n", "batch/memory.max": "2000000000\n"},
        2_000_000_000,
    ),
    "version 1": (
        "4:memory:/job\n5:pids:/other\n0::/\n",
        {
            "memory/job/memory.limit_in_bytes": "1000000000\n",
            "memory/memory.limit_in_bytes": "9223372036854771712\n",
            "pids/other/memory.limit_in_bytes": "5\n",
        },
        1_000_000_000,
    ),
    "both versions": (
        "9:cpu,memory:/a:b\n0::/c\n",
        {
            "memory/a:b/memory.limit_in_bytes": "4000000000",
            "unified/c/memory.max": "3500000000",
        },
        3_500_000_000,
    ),
    "a container that sees the path of its host": (
        "0::/docker/0123abcd\n",
        {"memory.max": "1500000000\n"},
        1_500_000_000,
    ),
}


@pytest.mark.parametrize("name", GROUPS)
def test_what_a_container_or_a_batch_system_allows_is_the_least_of_its_groups(
    name: str, tmp_path: Path
) -> None:
    told, files, least = GROUPS[name]
    files = {f"sys/fs/cgroup/{path}": text for path, text in files.items()}
    for path, text in {"proc/self/cgroup": told, **files}.items():
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path).write_text(text)
    assert min(limits_of_groups(tmp_path)) == least
    assert allowed_memory(tmp_path) == least


def test_a_system_without_control_groups_has_no_limits_of_them(tmp_path: Path) -> None:
    assert list(limits_of_groups(tmp_path)) == []


def test_a_slit_whose_tips_need_billions_of_pieces_is_refused_before_they_are_made() -> None:
    film = load("square-270um").text.partition("[film]")[2].partition("[")[0]
    outline = '[outline]\nkind = "regular-polygon"\nsides = 30\nlong_axis = "270 um"\n'
    slit = '[[holes]]\nlattice = "list"\ncentres = [["0 um", "0 um"]]\n'
    slit += 'semi_axes = ["1 nm", "10 um"]\n'
    device = parse(f'name = "slit"\nsource = "a test"\n{outline}{slit}[film]{film}')
    with pytest.raises(ParameterError, match=r"rims in .* pieces of .* larger or rounder"):
        build.mesh(device)


def test_condensed_cells_of_too_many_holes_are_refused_before_they_are_summed(
    allow_memory: Callable[[int], None],
) -> None:
    allow_memory(2**33)
    film = load("square-270um").text.partition("[film]")[2].partition("[")[0]
    lattice = 'lattice = "square"\npitch = "3.16 um"\ncount = [316, 316]\nradius = "1 um"\n'
    outline = '[outline]\nkind = "square"\nside = "1 mm"\n'
    device = parse(f'name = "sieve"\nsource = "a test"\n{outline}[holes]\n{lattice}[film]{film}')
    with pytest.raises(ParameterError, match=r"condensed cells on .* lower the resolution"):
        solve_modes(device, 2)
