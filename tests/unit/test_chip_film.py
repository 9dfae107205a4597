"""The film that all designs of a chip share."""

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from femnl.chip import fit_chip, read_chip
from femnl.chip.film import Design, slackening
from femnl.device.geometry import load
from femnl.observe.film import SimulatedFilm

SEED = 20261124


def test_the_slackening_of_a_square_is_that_of_its_side() -> None:
    """−E/((1 − ν) σ L): both sides of length L move in by d, a strain of 2d/L in each direction."""
    model = load("square-270um")
    film = model.film
    side = model.outline.length
    expected = -film.young / ((1 - film.poisson) * film.stress * side)
    assert slackening(model) == pytest.approx(expected, rel=1e-12)
    # A circle of radius R has P/A = 2/R
    circle = load("circle")
    film = circle.film
    expected = -film.young / (4 * (1 - film.poisson) * film.stress) * 4 / circle.outline.length
    assert slackening(circle) == pytest.approx(expected, rel=1e-3)


def test_an_edge_is_linearised_about_where_it_is() -> None:
    """Value and slope of ½(1 − β) ln(1 + 2 s d e^{−2δ}), with the stress before release e^{2δ}σ."""
    design = Design(np.array([13.0, 14.0]), np.array([-2e6, -5e5]), np.array([0.03, 0.3]))
    moved = 25e-9
    offset = 0.07

    def exact(d: float) -> np.ndarray[Any, Any]:
        left = 1 + 2 * design.slackening * d * np.exp(-2 * offset)
        return np.asarray(design.base + 0.5 * (1 - design.bending) * np.log(left))

    base, columns = design.about(moved, offset)
    assert base + moved * columns[:, 0] == pytest.approx(exact(moved), rel=1e-12)
    step = 1e-12
    slope = (exact(moved + step) - exact(moved - step)) / (2 * step)
    assert columns[:, 0] == pytest.approx(slope, rel=1e-3)
    assert columns[:, 1] == pytest.approx([0.03, 0.3])


def test_a_change_of_stress_changes_frequencies_by_what_bending_leaves(tmp_path: Path) -> None:
    """∂ ln f/∂ ln σ = ½(1 − β), with β the part of the energy in bending, by two simulations."""
    text = load("square-270um").text.replace('side = "270 um"', 'side = "40 um"')
    films = []
    for stress in ("1101.5 MPa", "1112.5 MPa"):
        path = tmp_path / f"{stress[:6]}.toml"
        path.write_text(text.replace("1101.5 MPa", stress), encoding="utf-8")
        films.append(SimulatedFilm(load(str(path)), 3))
    ratio = films[1].modes.frequency[0] / films[0].modes.frequency[0]
    rise = films[1].model.film.stress / films[0].model.film.stress
    assert rise > 1.009
    share = films[0].bending_share[0]
    assert share > 0.03
    assert np.log(ratio) / np.log(rise) == pytest.approx(0.5 * (1 - share), rel=2e-3)


def sizes(folder: Path, inwards: float, sides: tuple[float, ...], bending: bool = True) -> Path:
    """Write a study of squares whose edges moved inwards.

    Frequencies are those of the clamped plate as a membrane smaller by ℓ on every side, under the
    tension that the strain 2d/L in both directions leaves.
    """
    rng = np.random.default_rng(SEED)
    text = load("square-270um").text
    film = tomllib.loads(text)["film"]
    assert (film["young"], film["thickness"]) == ("250 GPa", "183.75 nm")
    young, poisson, density, thickness, stress = 250e9, 0.23, 3100.0, 183.75e-9, 1101.5e6
    lines = ['name = "sizes"']
    for side in sides:
        name = f"square-{side:g}um"
        own = text.replace('side = "270 um"', f'side = "{side:g} um"')
        if not bending:
            own = own.replace("bending = true", "bending = false")
        (folder / f"{name}.toml").write_text(own.replace("square-270um", name), encoding="utf-8")
        lines.append(f'[design.{name}]\ngeometry = "{name}.toml"')
        for k in range(4):
            length = side * 1e-6
            left = stress - young / (1 - poisson) * 2 * inwards / length
            rigidity = young * thickness**3 / (12 * (1 - poisson**2))
            layer = np.sqrt(rigidity / (left * thickness)) if bending else 0.0
            shift = np.exp(rng.normal(0, 1e-3))
            modes = []
            for m, n in ((1, 1), (2, 2)):
                k2 = np.pi**2 * (m**2 + n**2) / (length - 2 * layer) ** 2
                omega = np.sqrt(left / density * (k2 + layer**2 * k2**2))
                modes.append(
                    f'{{mode = "{m},{n}", frequency = {omega * shift / (2 * np.pi):.2f}, '
                    f"frequency_sd = 10.0}}"
                )
            lines.append(f'[[device]]\nname = "{name}-{k}"\ndesign = "{name}"')
            lines.append(f"modes = [{', '.join(modes)}]")
    path = folder / "study.toml"
    path.write_text("\n".join(lines), encoding="utf-8")
    return path


def test_devices_of_other_sizes_prove_an_edge_that_moves_inwards(tmp_path: Path) -> None:
    fit = fit_chip(read_chip(sizes(tmp_path, 20e-9, (60, 150, 400))))
    assert fit.film is not None
    proved = sum(p for name, p in fit.film.causes.items() if "edge" in name)
    assert proved > 0.99
    edge = next(p for p in fit.film.parameters if "edge" in p.name)
    assert edge.value == pytest.approx(20e-9, abs=3 * edge.sd)
    assert edge.sd < 1.5e-9
    # Four devices of a spread of 0.1 % leave the means 0.05 %, and the closed form is as good
    assert max(abs(r) for r in fit.film.residuals.values()) < 1e-3


def test_an_edge_that_moves_is_found_of_membranes_without_bending(tmp_path: Path) -> None:
    fit = fit_chip(read_chip(sizes(tmp_path, 20e-9, (60, 150, 400), bending=False)))
    assert fit.film is not None
    assert set(fit.film.causes) == {"one film as simulated", "edge moves inwards"}
    assert fit.film.causes["edge moves inwards"] > 0.99
    edge = next(p for p in fit.film.parameters if "edge" in p.name)
    assert edge.value == pytest.approx(20e-9, abs=3 * edge.sd)


def test_devices_of_one_size_cannot_and_say_which_would(tmp_path: Path) -> None:
    fit = fit_chip(read_chip(sizes(tmp_path, 20e-9, (270,))))
    assert fit.film is not None
    assert fit.film.causes["one film as simulated"] > 0.1
    assert "a square of 50 µm" in fit.film.measure_next
