"""`femnl geometry`: layouts to geometries and back, and pictures of what is wrong."""

from pathlib import Path

import gdstk
import pytest
from matplotlib.image import imread

from femnl.cli._main import run
from femnl.device.geometry import load
from tests.unit.layouts import box, circle, from_points, trampoline, write

LAYERS = ["--layers", "film=1/0,release=3/0,holes=2/0"]
WRONG = """name = "wrong"
[outline]
kind = "square"
side = "100 um"
[[holes]]
lattice = "list"
centres = [["0 um", "0 um"], ["49 um", "10 um"]]
radius = "3 um"
[[holes]]
lattice = "list"
centres = [["4 um", "0 um"]]
shape = {kind = "square", side = "5 um"}
[film]
thickness = "50 nm"
young = "250 GPa"
poisson = 0.23
density = "3100 kg/m^3"
stress = "1 GPa"
"""


@pytest.fixture(autouse=True)
def _own_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)


def orange(picture: str) -> int:
    """How many pixels have the colour of the marks, #D55E00."""
    red, green, blue = (imread(picture)[..., k] for k in range(3))
    return int(((abs(red - 0.835) < 0.05) & (abs(green - 0.369) < 0.05) & (blue < 0.05)).sum())


def test_a_layout_is_imported_exported_and_imported_again(
    capsys: pytest.CaptureFixture[str],
) -> None:
    write(Path("chip.gds"), *trampoline())
    assert run(["geometry", "import", "chip.gds", "one.toml", *LAYERS]) == 0
    assert "recognised 12 fillets drawn as chords" in capsys.readouterr().err
    assert run(["geometry", "export", "one.toml", "back.oas"]) == 0
    assert "--layers film=1/0,holes=2/0,frame=3/0" in capsys.readouterr().err
    words = ["back.oas", "two.toml", "--layers", "film=1/0,holes=2/0,frame=3/0"]
    assert run(["geometry", "import", *words]) == 0
    one, two = (Path(f"{name}.toml").read_text(encoding="utf-8") for name in ("one", "two"))
    assert one.replace("chip.gds", "back.oas") == two


def test_an_import_writes_over_no_geometry(capsys: pytest.CaptureFixture[str]) -> None:
    write(Path("chip.gds"), *trampoline())
    Path("mine.toml").write_text("# numbers of my own\n", encoding="utf-8")
    assert run(["geometry", "import", "chip.gds", "mine.toml", *LAYERS]) == 2
    assert "is there already" in capsys.readouterr().err
    assert Path("mine.toml").read_text(encoding="utf-8") == "# numbers of my own\n"


def test_holes_that_are_none_of_the_film_are_told(capsys: pytest.CaptureFixture[str]) -> None:
    film = gdstk.rectangle((0, 0), (50, 50), layer=1)
    holes = [gdstk.ellipse(at, 4, layer=2) for at in ((25, 25), (500, 25), (50, 10))]
    write(Path("chip.gds"), film, *holes)
    words = ["chip.gds", "one.toml", "--layers", "film=1/0,holes=2/0"]
    assert run(["geometry", "import", *words]) == 0
    told = capsys.readouterr().err
    assert "doubtful: hole off the film, left out at (504, 25) um" in told
    assert "doubtful: hole over the edge at (54, 10) um" in told
    assert "1 holes" in told


def test_check_draws_a_film_that_is_compressed_all_over(capsys: pytest.CaptureFixture[str]) -> None:
    layer = '[[layers]]\nname = "a"\nthickness = "1 um"\nyoung = "70 GPa"\npoisson = 0.34\n'
    layer += 'density = "3000 kg/m^3"\nstress = "-2 GPa"\n'
    Path("low.toml").write_text(load("circle").text + layer, encoding="utf-8")
    assert run(["geometry", "check", "low.toml"]) == 0
    assert "compression after release" in capsys.readouterr().out
    assert Path("low.png").is_file()


def test_a_sound_geometry_is_drawn_with_its_compression(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert run(["geometry", "check", "trampoline"]) == 0
    out = capsys.readouterr().out
    # Four edges a tether, and two fillets
    assert "24 pieces, 4 of them clamped" in out
    assert "a quarter is solved" in out
    assert "MPa at (" in out
    assert orange("trampoline.png") > 100
    assert run(["geometry", "check", "circle"]) == 0
    assert "compression after release  none" in capsys.readouterr().out
    assert orange("circle.png") == 0


def test_a_wrong_geometry_is_drawn_with_every_fault_marked(
    capsys: pytest.CaptureFixture[str],
) -> None:
    Path("wrong.toml").write_text(WRONG, encoding="utf-8")
    assert run(["geometry", "check", "wrong.toml"]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "wrote wrong.png"
    assert "hole 2 at (49, 10) um of radius 3 um cuts the outline" in lines[1]
    assert "opening 1 at (4, 0) um of 5 um and the round hole 1 at (0, 0) um" in lines[2]
    both = orange("wrong.png")
    Path("one.toml").write_text(WRONG.replace('["49 um", "10 um"]', '["30 um", "10 um"]'))
    assert run(["geometry", "check", "one.toml"]) == 2
    assert 1.6 * orange("one.png") < both < 2.4 * orange("one.png")


def test_a_wrong_layout_is_drawn_with_its_faults(capsys: pytest.CaptureFixture[str]) -> None:
    path = gdstk.FlexPath([(7, 8), (20, 8)], 0, layer=2, simple_path=True)
    bow = from_points([(200, 0), (300, 0), (200, 100), (300, 100)])
    library = gdstk.Library()
    library.new_cell("DEVICE").add(box(100, 100), bow, path)
    library.write_gds("bad.gds")
    assert run(["geometry", "check", "bad.gds", "--layers", "film=1/0,holes=2/0"]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "open path on layer 2/0 (holes) at (7, 8) um"
    assert lines[1] == "self-intersection (film) at (250, 50) um"
    assert lines[2] == "wrote bad.png"
    assert lines[3].startswith("femnl: bad.gds: open path on layer 2/0 (holes) at (7, 8) um")
    assert orange("bad.png") > 100


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["check", "chip.gds"], "femnl: chip.gds: --layers is missing; write e.g."),
        (["check", "circl"], "femnl: circl: neither a shipped geometry nor a file; did you mean"),
        (["import", "chip.gds", "a.txt", *LAYERS], "femnl: a.txt: expected a name that ends in"),
        (["import", "no.gds", "a.toml", *LAYERS], "femnl: no.gds: no such file; check the path"),
        (["export", "circle", "a.png"], "femnl: a.png: expected a name that ends in .gds or .oas"),
        (["export", "circle"], "femnl: Missing argument 'dest'"),
        (["mend", "circle"], "femnl: No such command 'mend'"),
    ],
)
def test_wrong_requests_are_met_with_one_line(
    words: list[str], line: str, capsys: pytest.CaptureFixture[str]
) -> None:
    write(Path("chip.gds"), *trampoline())
    assert run(["geometry", *words]) == 2
    (said,) = capsys.readouterr().err.splitlines()
    assert said.startswith(line)


def test_a_layout_with_a_metal_is_imported_and_checked_with_its_numbers(
    capsys: pytest.CaptureFixture[str],
) -> None:
    write(Path("pad.gds"), box(200, 200), circle(40, layer=5))
    metal = ["--layers", "film=1/0,metal=5/0", "--metal", "thickness=30 nm,stress=-80 MPa"]
    assert run(["geometry", "import", "pad.gds", "pad.toml", *metal]) == 0
    assert load("pad.toml").layers[0].stress == -80e6
    assert run(["geometry", "check", "pad.gds", *metal]) == 0
    assert "aluminium with young = 70 GPa" in capsys.readouterr().err
