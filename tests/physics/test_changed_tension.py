"""Films under another tension, as the diagnosis changes them, against the same films solved anew.

Solved anew on the same mesh, so that what is left is the expansion and not the mesh; and against
closed forms and sums of many sines or polynomials.
"""

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from itertools import product

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import eigh
from scipy.sparse import csc_matrix

from femnl.core.domain import Prestress
from femnl.core.modes import Modes
from femnl.core.operators import Projection, Units
from femnl.core.stages import ModalSystem
from femnl.core.tension import TensionChanges
from femnl.device.geometry import parse
from femnl.device.mesh import mesh
from femnl.effects import library
from femnl.mechanics.fem.elements import Space
from femnl.mechanics.fem.forms import Assembly, as_matrix, cells, local_matrices, slope
from femnl.mechanics.fem.solvers import lowest_eigenpairs
from femnl.mechanics.fem.stress import unit_stress
from femnl.mechanics.modes.operators import Operators
from femnl.mechanics.modes.projection import project
from femnl.mechanics.prestress import solve_prestress, solve_units
from femnl.mechanics.tension import effort_of, less_effort, solve_tension
from femnl.mechanics.tension.effort import MANY
from femnl.observe.film import UNITS, SimulatedFilm
from femnl.pipeline import solve_modes
from tests.physics.changed_films import system_of
from tests.physics.test_relaxed_changes import FILM as FOUR_HOLES
from tests.physics.test_tension_gradient import FILM, SQUARE, polynomials, relaxed_bowl
from tests.unit.test_diagnose_films import sheared

Array = NDArray[np.float64]
COUNT = 48
LOWEST = 14
HEXAGON = FILM.format(outline='kind = "regular-polygon"\nsides = 6\nlong_axis = "100 um"')
FILMS = {"square": SQUARE, "hexagon": HEXAGON, "four holes": FOUR_HOLES}
WITH_SLOW = ["square", "hexagon", pytest.param("four holes", marks=pytest.mark.slow)]


@cache
def whole(name: str) -> tuple[Modes, Units, Projection]:
    """Modes in the mesh of a whole film, where every change acts on one set of unknowns."""
    modes = solve_modes(parse(FILMS[name]), COUNT, "full", 0.6, cache=False)
    units = solve_units(modes.domain, UNITS)
    tension = solve_tension(modes, units, effort_of(modes))
    return modes, units, replace(project(modes, units), tension=tension)


def on_film(modes: Modes, projection: Projection) -> ModalSystem:
    """Return the film's matrices with what couples modes of nearly one frequency.

    `Modes` takes two whose ω² differ by less than 1e-6 as having the same, by 5e-8 of a frequency.
    """
    film = modes.domain.model.film
    operators = Operators(modes.prestress, modes.degree)
    stiffness = np.zeros((COUNT, COUNT))
    for parity in set(modes.parity):
        mine = np.flatnonzero([own == parity for own in modes.parity])
        shapes = modes.shapes[mine]
        work = shapes @ (operators.stiffness(parity) @ shapes.T)
        stiffness[np.ix_(mine, mine)] = modes.domain.copies * work
    return ModalSystem(stiffness, np.diag(modes.effective_mass), film.stress, film, projection)


def lowest(system: ModalSystem, causes: Mapping[str, Mapping[str, float]]) -> Array:
    """Return the frequencies [Hz] of the lowest modes under some causes."""
    for name, values in causes.items():
        system = library()[name].changes["operators"](system, values)
    square = eigh(system.stiffness, system.mass, eigvals_only=True)
    return np.asarray(np.sqrt(square[:LOWEST]) / (2 * np.pi))


def solved(edge: Prestress, degree: int) -> Array:
    """Return the lowest frequencies [Hz] of all sectors, each as it is; see `on_film`."""
    operators = Operators(edge, degree)
    squares = []
    for parity in product((1, -1), repeat=2):
        free = operators.free(parity)
        stiffness = csc_matrix(operators.stiffness(parity)[free][:, free])
        mass = csc_matrix(operators.mass[free][:, free])
        squares.append(lowest_eigenpairs(stiffness, mass, LOWEST)[0])
    return np.asarray(np.sqrt(np.sort(np.concatenate(squares))[:LOWEST]) / (2 * np.pi))


def stressed(modes: Modes, units: Units, parts: Mapping[tuple[int, int], float]) -> Array:
    """Return frequencies [Hz] of the film with more stress.

    Args: parts: how much of σ is added of each weight and direction.
    """
    domain = modes.domain
    film = domain.model.film
    operators = Operators(modes.prestress, modes.degree)
    space = Space(domain.mesh, modes.degree)
    more = Assembly(space.size)
    order = 2 * modes.degree
    for cell, unit in zip(cells(space, order), unit_stress(domain, units, order), strict=True):
        field = film.stress * sum(part * unit[place] for place, part in parts.items())
        local = local_matrices(slope(cell.jet), as_matrix(field), film.thickness * cell.dx)
        more.add(local, space.dofs[cell.triangles])
    free = operators.free(())
    stiffness = csc_matrix((operators.stiffness(()) + more.matrix())[free][:, free])
    square, _ = lowest_eigenpairs(stiffness, csc_matrix(operators.mass[free][:, free]), LOWEST + 4)
    return np.asarray(np.sqrt(square[:LOWEST]) / (2 * np.pi))


XX, YY, XY = (0, 0), (0, 1), (0, 2)
CAUSES = {
    "anisotropy": ({"stress_anisotropy": {"anisotropy": 0.2}}, {XX: 0.1, YY: -0.1}),
    "anisotropy the other way": (
        {"stress_anisotropy": {"anisotropy": -0.2}},
        {XX: -0.1, YY: 0.1},
    ),
    "half of it": ({"stress_anisotropy": {"anisotropy": 0.11}}, {XX: 0.055, YY: -0.055}),
    "shear": ({"shear_stress": {"shear": -0.1}}, {XY: -0.1}),
    "half the shear": ({"shear_stress": {"shear": 0.057}}, {XY: 0.057}),
    "gradient": (
        {"tension_gradient": {"slope_x": 0.05, "slope_y": -0.05, "bowl": 0.05}},
        {(1, 0): 0.05, (1, 1): 0.05, (2, 0): -0.05, (2, 1): -0.05}
        | {(w, d): 0.05 for w in (3, 5) for d in (0, 1)},
    ),
    "bowl": (
        {"tension_gradient": {"slope_x": 0.0, "slope_y": 0.0, "bowl": -0.05}},
        {(w, d): -0.05 for w in (3, 5) for d in (0, 1)},
    ),
    "anisotropy and shear": (
        {"stress_anisotropy": {"anisotropy": 0.2}, "shear_stress": {"shear": 0.1}},
        {XX: 0.1, YY: -0.1, XY: 0.1},
    ),
    "shear and bowl": (
        {
            "shear_stress": {"shear": 0.1},
            "tension_gradient": {"slope_x": 0.0, "slope_y": 0.0, "bowl": 0.05},
        },
        {XY: 0.1} | {(w, d): 0.05 for w in (3, 5) for d in (0, 1)},
    ),
}


@pytest.mark.parametrize("name", WITH_SLOW)
@pytest.mark.parametrize("cause", CAUSES)
def test_a_stress_does_to_the_lowest_modes_what_it_does_to_the_film(name: str, cause: str) -> None:
    modes, units, projection = whole(name)
    causes, parts = CAUSES[cause]
    anew = stressed(modes, units, parts)
    near = 1e-8 if len(causes) == 1 else 5e-8
    assert lowest(on_film(modes, projection), causes) == pytest.approx(anew, rel=near)


@pytest.mark.parametrize("cause", ["anisotropy", "shear", "gradient"])
@pytest.mark.slow
def test_responses_of_lower_elements_make_up_most_of_a_change(cause: str) -> None:
    # As on films of too many unknowns for elements of the modes' degree
    modes, units, projection = whole("four holes")
    causes, parts = CAUSES[cause]
    less = replace(projection, tension=solved_with_less_effort())
    found = lowest(on_film(modes, less), causes)
    # Coarse triangles around large holes; base modes alone miss ten times as much
    assert found == pytest.approx(stressed(modes, units, parts), rel=2e-5)


@cache
def solved_with_less_effort() -> TensionChanges:
    """Return what changes do to the film with four holes, by elements of one degree less."""
    modes, units, _ = whole("four holes")
    return solve_tension(modes, units, less_effort(modes.degree - 1))


def test_the_effort_falls_with_the_unknowns_of_a_mesh() -> None:
    modes, _, _ = whole("square")
    assert Space(modes.domain.mesh, modes.degree).size < MANY
    assert effort_of(modes).degree == modes.degree
    domain = mesh(parse(SQUARE), "full", 4.0, modes.degree)
    fine = replace(modes, prestress=replace(modes.prestress, domain=domain))
    assert Space(fine.domain.mesh, fine.degree).size > MANY
    assert effort_of(fine) == less_effort(fine.degree - 1)


def test_the_base_modes_alone_would_miss_by_far() -> None:
    modes, units, projection = whole("square")
    plain = on_film(modes, projection)
    within = plain.stiffness + plain.stress * 0.2 * projection.slopes[XY]
    crude = np.sqrt(eigh(within, plain.mass, eigvals_only=True)[:LOWEST]) / (2 * np.pi)
    assert np.abs(crude / stressed(modes, units, {XY: 0.1}) - 1).max() > 1e-4


@cache
def quarter(name: str) -> SimulatedFilm:
    return SimulatedFilm(parse(FILMS[name]), COUNT)


@pytest.mark.parametrize("name", WITH_SLOW)
@pytest.mark.parametrize("share", [0.2, 0.13, 0.03, 0.004])
def test_a_yielding_edge_does_what_it_does_to_the_film(name: str, share: float) -> None:
    found = quarter(name)
    domain = found.modes.domain
    compliance = share * found.projection.reach
    across = domain.model.film.young * domain.model.film.thickness / compliance
    along = across * (1 - domain.model.film.poisson) / 2
    clamp = replace(domain.model.clamp, normal=across, shear=along)
    edge = solve_prestress(replace(domain, model=replace(domain.model, clamp=clamp)), 4)
    anew = solved(replace(edge, domain=domain), found.modes.degree)
    causes = {"yielding_edge": {"compliance": compliance}}
    assert lowest(on_film(found.modes, found.projection), causes) == pytest.approx(anew, rel=2e-8)


@pytest.mark.parametrize("name", WITH_SLOW)
@pytest.mark.parametrize("elongation", [-0.1, -0.03, 0.06, 0.1])
def test_other_sides_do_what_they_do_to_the_film(name: str, elongation: float) -> None:
    found = quarter(name)
    domain = found.modes.domain
    factor = np.array([1 + elongation / 2, 1 / (1 + elongation / 2)])[:, None]
    mesh = replace(domain.mesh, doflocs=domain.mesh.doflocs * factor)
    stretched = replace(domain, mesh=mesh, diagonal=False)
    edge = solve_prestress(stretched, found.modes.prestress.degree)
    anew = solved(edge, found.modes.degree)
    # Rims of stretched holes are meshed as arcs of circles, and the mass of the film with them
    near = 4e-7 if name == "four holes" else 1e-8
    causes = {"aspect_ratio": {"elongation": elongation}}
    assert lowest(on_film(found.modes, found.projection), causes) == pytest.approx(anew, rel=near)


STIFF = SQUARE.replace("bending = false", "bending = true").replace('"50 nm"', '"200 nm"')


@pytest.mark.slow
def test_the_bending_layer_follows_the_sides() -> None:
    # On a mesh of its own for each film; the layer at the edge takes 1 % of a frequency.
    found = SimulatedFilm(parse(STIFF), COUNT)
    elongation = 0.1
    sides = [100 * (1 + elongation / 2), 100 / (1 + elongation / 2)]
    outline = f'kind = "rectangle"\nwidth = "{sides[0]!r} um"\nheight = "{sides[1]!r} um"'
    other = STIFF.replace('kind = "square"\nside = "100 um"', outline)
    anew = solve_modes(parse(other), LOWEST, cache=False).frequency
    own = lowest(system_of(found), {"aspect_ratio": {"elongation": elongation}})
    assert own == pytest.approx(anew, rel=3e-6)


def test_sectors_of_a_quarter_do_what_the_whole_film_does() -> None:
    modes, _, projection = whole("square")
    causes = {
        "shear_stress": {"shear": 0.08},
        "tension_gradient": {"slope_x": 0.05, "slope_y": 0.03, "bowl": -0.04},
    }
    part = quarter("square")
    ratio = lowest(system_of(part), causes) / lowest(system_of(part), {})
    other = lowest(on_film(modes, projection), causes) / lowest(on_film(modes, projection), {})
    assert ratio == pytest.approx(other, rel=3e-6)


def over_first(causes: Mapping[str, Mapping[str, float]]) -> Array:
    """Return frequencies of the square over that of its first mode as it is."""
    plain = system_of(quarter("square"))
    return np.asarray(lowest(plain, causes) / lowest(plain, {})[0])


@pytest.mark.parametrize(
    ("causes", "squares"),
    [
        ({"stress_anisotropy": {"anisotropy": 0.2}}, (1.1, 0.9)),
        ({"aspect_ratio": {"elongation": 0.1}}, (1.05**-2, 1.05**2)),
    ],
)
def test_sines_stay_sines_at_the_strongest_stretch(
    causes: dict[str, dict[str, float]], squares: tuple[float, float]
) -> None:
    m = np.arange(1, 15)
    exact = np.sort(np.sqrt(np.add.outer(*(s * m**2 / 2 for s in squares)).ravel()))[:LOWEST]
    assert over_first(causes) == pytest.approx(exact, rel=1e-7)


@pytest.mark.parametrize("shear", [0.1, -0.03, 0.01])
def test_shear_is_as_many_more_sines_give_it(shear: float) -> None:
    # Sines lack 1e-6 of the tenth mode at 0.1 when 30 are taken, and fall as 1/n³
    exact = sheared(shear, 30)[0][:LOWEST]
    assert over_first({"shear_stress": {"shear": shear}}) == pytest.approx(exact, rel=3e-6)


@pytest.mark.parametrize("bowl", [0.05, -0.02])
def test_a_bowl_is_as_many_polynomials_give_it(bowl: float) -> None:
    terms = 18
    _, w, value, slopes = polynomials(terms)
    mass, stiff = (value * w) @ value.T, (slopes * w) @ slopes.T
    root = np.sqrt(np.outer(w, w)).ravel()
    dx = np.einsum("mx,ny->mnxy", slopes, value).reshape(terms**2, -1) * root
    dy = np.einsum("mx,ny->mnxy", value, slopes).reshape(terms**2, -1) * root
    xx, yy, xy = (bowl * part.ravel() for part in relaxed_bowl(16))
    mixed = (xy * dx) @ dy.T
    stiffness = np.kron(stiff, mass) + np.kron(mass, stiff)
    stiffness += (xx * dx) @ dx.T + (yy * dy) @ dy.T + mixed + mixed.T
    square = eigh(stiffness, np.kron(mass, mass), eigvals_only=True)[:LOWEST]
    exact = np.sqrt(square * 2) / np.pi
    causes = {"tension_gradient": {"slope_x": 0.0, "slope_y": 0.0, "bowl": bowl}}
    assert over_first(causes) == pytest.approx(exact, rel=2e-7)
