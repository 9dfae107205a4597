"""Options of `femnl modes` together: numbers, labels, and what one does not tell of another."""

import numpy as np
import pytest

from femnl import load, solve_modes, solve_modes_near
from femnl.cli._main import run
from femnl.core.errors import ParameterError
from femnl.device.geometry import parse
from femnl.mechanics.modes.quality import solve_quality
from femnl.plot.film import film_box
from femnl.plot.mechanics import close_up

RIBBON = """
name = "ribbon"
[outline]
kind = "rectangle"
width = "1000 um"
height = "25 um"
[film]
thickness = "100 nm"
young = "250 GPa"
poisson = 0.23
density = "3100 kg/m^3"
stress = "1 GPa"
[model]
bending = false
"""


def test_modes_near_a_frequency_keep_their_numbers_in_tables_of_couplings(
    capsys: pytest.CaptureFixture[str],
) -> None:
    options = ["--near", "3.2 MHz", "--count", "2", "--tensor", "--resolution", "0.5"]
    assert run(["modes", "square-270um", *options]) == 0
    table = capsys.readouterr().out.partition("Cubic force")[2].splitlines()
    assert table[1].split() == ["i\\j", "4", "5"]
    assert [line.split()[0] for line in table[2:4]] == ["4", "5"]


def test_high_modes_near_a_frequency_have_labels() -> None:
    modes = solve_modes_near(load("square-270um"), 15e6, 2, resolution=0.5)
    assert set(modes.label) == {"(12,6)+(6,12)", "(12,6)−(6,12)"}


def test_modes_along_a_ribbon_have_labels() -> None:
    modes = solve_modes(parse(RIBBON), 12, resolution=0.5)
    assert list(modes.label) == [f"({m},1)" for m in range(1, 13)]


def test_losses_beside_a_bow_are_called_those_of_the_flat_film(
    capsys: pytest.CaptureFixture[str],
) -> None:
    options = ["--count", "1", "--resolution", "0.4", "--q", "--dilution"]
    assert run(["modes", "square-270um", *options, "--bow", "10 Pa"]) == 0
    bent = capsys.readouterr().out
    assert "Of the flat film: 1/Q = " in bent
    assert "Of the flat film: Dissipation dilution" in bent
    assert run(["modes", "square-270um", *options]) == 0
    assert "flat film" not in capsys.readouterr().out


def test_gas_that_is_no_single_molecules_is_told_or_refused(
    caplog: pytest.LogCaptureFixture,
) -> None:
    """Of nitrogen at 295 K and 1 bar, λ = 67 nm (CRC Handbook: 66 nm at 293 K)."""
    modes = solve_modes(load("square-270um"), 1, resolution=0.5)
    with pytest.raises(ParameterError, match=r"gas, 0\.067 µm, is not long .* below 25 Pa, or"):
        solve_quality(modes, 1e5)
    assert "mean free path" not in caplog.text
    solve_quality(modes, 50.0)
    assert "mean free path of the gas, 134 µm, is not long against the film, 270 µm" in caplog.text
    caplog.clear()
    solve_quality(modes, 20.0)
    assert "mean free path" not in caplog.text


def test_a_closer_look_stays_within_a_film_with_one_large_hole() -> None:
    hole = '[[holes]]\nlattice = "list"\ncentres = [["0 um", "0 um"]]\nradius = "6 um"\n'
    model = parse(RIBBON.replace('"1000 um"', '"30 um"') + hole)
    left, right, bottom, top = close_up(model)
    around = film_box(model.edge_outline, 0.01)
    assert around[0] <= left < right <= around[1]
    assert around[2] <= bottom < top <= around[3]
    assert np.isclose(right - left, top - bottom)
