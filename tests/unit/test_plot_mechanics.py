"""Pictures of the film: to scale, with round holes and the right colours, or one clear line."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

import femnl
from femnl.core.errors import MissingLibraryError, ParameterError
from femnl.core.modes import Modes
from femnl.device.geometry import parse
from femnl.io.results.surface import unfold
from femnl.pipeline import solve_modes, solve_release
from femnl.plot import screen
from femnl.plot.film import TALLEST, draw_flat, draw_raised, film_box, film_field
from femnl.plot.mechanics import close_up, film_figure, mode_gallery, view

SIDE = 100e-6
RADIUS = 10e-6
PLATE = """
name = "plate-with-a-hole"
source = "made up"
[outline]
kind = "square"
side = "100 um"
[holes]
lattice = "list"
centres = [["0 um", "0 um"]]
radius = "10 um"
[film]
thickness = "100 nm"
young = "250 GPa"
poisson = 0.23
density = "3100 kg/m^3"
stress = "1 GPa"
"""


@pytest.fixture(scope="module")
def modes() -> Modes:
    """Four modes of a square plate with a hole in its middle."""
    return solve_modes(parse(PLATE), count=4, cache=False)


def test_a_film_and_its_hole_are_drawn_to_scale_and_round(modes: Modes) -> None:
    surface = unfold(modes)
    box = film_box(modes.domain.model.outline, 0.05)
    image = draw_flat(modes, surface, film_field(modes, surface, "thickness"), box, 880)
    assert image.shape == (880, 880, 3)
    drawn = np.flatnonzero((image < 250).any(axis=(0, 2)))
    # The line of the outline is two pixels wide
    assert np.ptp(drawn) == pytest.approx(880 / 1.1, abs=4)
    axis = np.linspace(box[0], box[1], 881)[:-1] + (box[1] - box[0]) / 1760
    distance = np.hypot(axis[:, None], axis[None, :])
    red = image[..., 0].astype(float)
    white = (red - red[200, 440]) / (255 - red[200, 440])
    assert white[distance < 0.4 * SIDE].sum() * (axis[1] - axis[0]) ** 2 == pytest.approx(
        np.pi * RADIUS**2, rel=2e-3
    )
    assert np.all(white[distance < 0.985 * RADIUS] > 0.99)
    assert np.all(white[(distance > 1.015 * RADIUS) & (distance < 0.48 * SIDE)] < 0.01)


def test_a_slender_film_that_stands_is_drawn_as_tall_as_a_graphics_card_can(
    modes: Modes, capfd: pytest.CaptureFixture[str]
) -> None:
    field = film_field(modes, unfold(modes), "mesh")
    image = draw_flat(modes, unfold(modes), field, (-SIDE, SIDE, -30 * SIDE, 30 * SIDE))
    assert 0.99 * TALLEST < len(image) <= TALLEST
    assert len(image) == 30 * image.shape[1]
    assert capfd.readouterr().err == ""


def test_the_two_sides_of_an_antisymmetric_mode_are_red_and_blue_and_its_node_is_pale(
    modes: Modes,
) -> None:
    surface = unfold(modes)
    index = modes.label.index("(2,1)")
    image = draw_flat(
        modes,
        surface,
        film_field(modes, surface, "shape", index + 1),
        film_box(modes.domain.model.outline),
        400,
    ).astype(int)
    here = np.argmin(np.hypot(surface.points[:, 0] - SIDE / 4, surface.points[:, 1]))
    sign = np.sign(surface.shapes[index][here])
    left = image[200, 104]
    middle = image[100, 200]
    right = image[200, 296]
    assert np.sign(right[0] - right[2]) == sign
    assert np.sign(left[0] - left[2]) == -sign
    assert middle.min() > 235


def test_the_relief_of_a_positive_mode_rises_above_the_film_at_rest(modes: Modes) -> None:
    surface = unfold(modes)
    image = draw_raised(modes, surface, film_field(modes, surface, "shape", 1), 400).astype(int)
    red = (image[..., 0] - image[..., 2]) > 60
    assert red.sum() > 0.1 * red.size
    assert np.median(np.nonzero(red)[0]) < 0.5 * image.shape[0]


def test_stress_in_units_of_the_film_stress_is_two_at_the_rim_of_a_small_hole() -> None:
    # Kirsch: equal tension in all directions doubles along the rim of a hole in an infinite plate.
    modes = solve_modes(
        parse(PLATE.replace('radius = "10 um"', 'radius = "1 um"')), count=1, cache=False
    )
    surface = unfold(modes)
    stress = film_field(modes, surface, "stress").values
    assert stress is not None
    rim = np.hypot(*surface.points.T) < 1.0001e-6
    assert stress[rim] == pytest.approx(2.0, rel=0.01)
    assert stress[np.abs(surface.points).max(axis=1) > 0.45 * SIDE] == pytest.approx(1.0, rel=0.01)


def test_a_closer_look_shows_the_outermost_hole_and_stays_within_the_film(modes: Modes) -> None:
    left, right, bottom, top = close_up(modes.domain.model)
    assert left < -RADIUS < RADIUS < right < SIDE / 2 * 1.03
    assert bottom < -RADIUS < RADIUS < top < SIDE / 2 * 1.03


@pytest.mark.parametrize("what", ["mesh", "stress", "shape", "thickness"])
def test_every_picture_is_written_to_a_file(modes: Modes, what: str, tmp_path: Path) -> None:
    view(modes, what, 2, tmp_path / "film.png")
    picture = imread(tmp_path / "film.png")
    assert picture.shape[1] > 700
    assert picture[..., :3].std() > 0.02
    assert [path.name for path in tmp_path.iterdir()] == ["film.png"]


def test_the_gallery_names_each_mode_and_its_frequency(modes: Modes) -> None:
    titles = [axes.get_title() for axes in mode_gallery(modes).axes if axes.get_title()]
    assert len(titles) == 4
    assert titles[0].startswith("1  (1,1)\n")
    assert f"{modes.frequency[0] / 1e6:.4f} MHz" in titles[0]


def test_a_word_or_a_mode_that_cannot_be_drawn_is_refused_with_what_can(
    modes: Modes, tmp_path: Path
) -> None:
    with pytest.raises(
        ParameterError, match="'strain': femnl draws mesh, stress, shape, thickness"
    ):
        film_figure(modes, "strain")
    with pytest.raises(ParameterError, match=r"mode 5: 4 modes were solved; choose 1 to 4"):
        film_figure(modes, "shape", 5)
    with pytest.raises(
        ParameterError, match=r"film\.doc: pictures are written as \.png, \.pdf, \.svg"
    ):
        view(modes, "mesh", 1, tmp_path / "film.doc")


def test_a_missing_opengl_library_is_one_line_and_no_crash(tmp_path: Path) -> None:
    for name in ("libEGL.so.1", "libEGL.so", "libOSMesa.so.8", "libOSMesa.so"):
        (tmp_path / name).touch()  # found first, and not a library: as good as absent
    script = (
        "from femnl.core.errors import MissingLibraryError\nfrom femnl.plot.screen import "
        "need_offscreen\ntry:\n    "
        "need_offscreen()\n"
    )
    script += "except MissingLibraryError as error:\n    print(error)"
    environment = os.environ | {
        "LD_LIBRARY_PATH": str(tmp_path),
        "PYTHONPATH": str(Path(__file__).parents[2]),
    }
    done = subprocess.run(
        [sys.executable, "-c", script], env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0
    assert (
        done.stdout
        == "pictures need OpenGL without a display; neither EGL nor OSMesa works here: install "
        "one (Debian: apt-get "
        "install "
        "libegl1)\n"
    )


def test_a_missing_display_is_one_line_and_no_crash(
    modes: Modes, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    screen._first_usable.cache_clear()
    with pytest.raises(MissingLibraryError, match="name a file to draw into instead"):
        view(modes, "mesh")


def test_what_needs_no_mode_is_drawn_of_a_film_that_has_none(tmp_path: Path) -> None:
    """A film under compression buckles, and its stress is what one wants to see."""
    model = femnl.load("trampoline").with_("model.bending", False)
    film = solve_release(model, resolution=0.5)
    assert len(film.frequency) == 0
    solved = solve_modes(femnl.load("circle"), 1, resolution=0.5, cache=False)
    released = solve_release(femnl.load("circle"), resolution=0.5)
    assert unfold(released).stress == pytest.approx(unfold(solved).stress)
    for what in ("mesh", "stress", "thickness"):
        view(film, what, out=tmp_path / f"{what}.png")
        assert (tmp_path / f"{what}.png").stat().st_size > 10_000
    with pytest.raises(ParameterError, match="mode"):
        view(film, "shape", out=tmp_path / "shape.png")
