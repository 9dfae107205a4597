"""How far the ledge of device J10 moves, what f22 − 2 f11 that makes, and what else could.

Run `python -m benchmarks.ledge`; it takes two minutes and prints three tables: the motion of the
edge by two methods and on several meshes, f22 − 2 f11 over what is known of the device, and how
well that and its rivals account for the measured 249 Hz.
"""

import sys
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.ledge_film import sheet_of
from benchmarks.ledge_modes import detuning
from benchmarks.ledge_rivals import weigh
from benchmarks.ledge_section import OXIDE, Materials, solve_ledge
from benchmarks.ledge_solid import USUAL_GRID, USUAL_WAFER, Grid, Moved, Wafer, solve_solid
from benchmarks.ledge_wafer import edge_motion
from femnl import load
from femnl.core.device import Film, Model
from femnl.core.outline import Holes

Array = NDArray[np.float64]

PITCH = 8.56e-6
SIDE = 270e-6
LEFT = 183.75e-9  # mean thickness of the film, arXiv:2502.19191, supplement S6
REACH = 9.98e-6  # of the etch beyond the rims of the holes
MEAN_DISTANCE = 0.3826 * PITCH - 0.9e-6  # from the rim of the nearest hole, over a cell
# A square of oxide for each corner, as large as what the etch leaves of a corner of 10.88 µm
CORNER = 10.88e-6 * float(np.sqrt(1 - np.pi / 4))
# The whole etched, tapered device with rigid edges, less the same as an even film with sharp
# corners: `python -m benchmarks.open_numbers --full` gives 1164 ± 2 Hz for the first
WHOLE = 1164.0 - 1192.9

RADII = np.array([0.5e-6, 0.9e-6, 1.4e-6])
BELOW = np.array([0.0, 56e-9, 112e-9])
PRESSURES = np.array([150e6, 300e6, 450e6])

DRAWS = 20000


@dataclass(frozen=True)
class Prior:
    """Mean and standard deviation of what is known of J10."""

    # not given; 0.9 µm makes the etch reach the quoted 10 µm; 0.5 … 1.4 µm
    radius: tuple[float, float] = (0.9e-6, 0.25e-6)
    # gap less oxide, whose 3.17 µm is good to a percent; ≥ 0
    below: tuple[float, float] = (56e-9, 32e-9)
    # not measured; thermal oxide is 280 MPa by expansion from 1000 °C, 250 … 350 MPa assumed
    pressure: tuple[float, float] = (300e6, 40e6)
    # of the motion: shape of the oxide's face 4 %, the film as a sheet 2 %
    motion: tuple[float, float] = (1.0, 0.05)
    # silicon's anisotropy, the corners' shape, scallops and the homogenised film, in Hz
    model: tuple[float, float] = (0.0, 60.0)


USUAL_PRIOR = Prior()


def etched(film: Film, below: float) -> Film:
    """The film that the etch leaves if it took `below` [m] on average from below.

    There it began at the rim of a hole and came a distance d later, d/REACH of the time. What else
    is missing was taken from above, everywhere.
    """
    if below == 0:
        return film
    taper = below / (1 - MEAN_DISTANCE / REACH)
    return replace(film, thickness=LEFT + below, taper=taper, taper_length=REACH)


def edge_by_solid(
    device: Model, wafer: Wafer = USUAL_WAFER, grid: Grid = USUAL_GRID, corner: float = CORNER
) -> Moved:
    """Motion of the edge of J10 by each load, on the wafer in three dimensions."""
    film = etched(device.film, BELOW[1])
    return solve_solid(sheet_of(device, film, PITCH, SIDE, corner), wafer, grid)


def on_ledge(device: Model, moved: Moved, pressure: float, scale: float = 1.0) -> float:
    """f22 − 2 f11 [Hz] of a device whose edge moves under the pressure [Pa] of its oxide."""
    tension = np.array(sheet_of(device, device.film, PITCH, SIDE).tension)[::-1]
    loads = scale * np.array([pressure, *tension])
    inwards = loads @ moved.inwards
    along = loads @ moved.along
    return detuning(
        device,
        lambda s: (np.interp(s, moved.places, inwards), np.interp(s, moved.places, along)),
    )


def tables(device: Model, moved: Moved) -> Callable[[Array], Array]:
    """f22 − 2 f11 [Hz] of the whole device at (n, 3) radii, thicknesses from below and pressures.

    A polynomial of second degree in each.
    """
    values = np.empty((len(RADII), len(BELOW), len(PRESSURES)))
    for i, radius in enumerate(RADII):
        for j, below in enumerate(BELOW):
            holes = Holes(np.array(device.holes.centres), radius)
            model = replace(device, holes=holes, film=etched(device.film, below))
            for k, pressure in enumerate(PRESSURES):
                values[i, j, k] = on_ledge(model, moved, pressure) + WHOLE

    def at(places: Array) -> Array:
        weights = [
            _lagrange(nodes, places[:, axis])
            for axis, nodes in enumerate((RADII, BELOW, PRESSURES))
        ]
        return np.asarray(np.einsum("ijk,ni,nj,nk->n", values, *weights))

    return at


def _lagrange(nodes: Array, places: Array) -> Array:
    """Weight of each of three nodes at places, (n, 3)."""
    weights = np.ones((len(places), len(nodes)))
    for i, node in enumerate(nodes):
        for other in np.delete(nodes, i):
            weights[:, i] *= (places - other) / (node - other)
    return weights


def expected(table: Callable[[Array], Array], prior: Prior = USUAL_PRIOR, seed: int = 1) -> Array:
    """f22 − 2 f11 [Hz] of draws from what is known, (n,)."""
    rng = np.random.default_rng(seed)

    def draw(known: tuple[float, float]) -> Array:
        return np.asarray(rng.normal(*known, DRAWS))

    radius, below, pressure = draw(prior.radius), draw(prior.below), draw(prior.pressure)
    # the film's own pull nearly cancels, so the whole motion goes with the oxide's pressure
    pressure = pressure * draw(prior.motion)
    kept = (radius > RADII[0]) & (radius < RADII[-1]) & (below > 0) & (below < BELOW[-1])
    kept &= (pressure > PRESSURES[0]) & (pressure < PRESSURES[-1])
    places = np.stack([radius, below, pressure], axis=-1)[kept]
    return np.asarray(table(places) + draw(prior.model)[kept])


def convergence(device: Model) -> Moved:
    """Print the motion of the edge by two methods and on several meshes; return the usual one."""
    section = solve_ledge(240e-9)
    middle = np.array([0.0])
    pull, push = edge_motion(section, middle, SIDE, OXIDE)
    say(
        f"cross-section and sides: {280e15 * push[0, 0]:.2f} nm by the oxide at −280 MPa, "
        f"{pull[0, 0] * 1e12:.1f} pm per N/m by a pull, before the film gives way"
    )
    usual = edge_by_solid(device)
    film = replace(device, film=etched(device.film, BELOW[1]))
    cases = {
        "solid": usual,
        "solid, coarser": edge_by_solid(device, grid=Grid(5e-6, 2.5, 2)),
        "solid, wafer held twice as far": edge_by_solid(device, Wafer(beyond=1600e-6)),
        "solid, back glued": edge_by_solid(device, Wafer(glued=True)),
        "solid, upright face": edge_by_solid(device, Wafer(foot=0.0)),
        "solid, sharp corners": edge_by_solid(device, corner=0.0),
        "solid, silicon as along <100>": edge_by_solid(
            device, Wafer(materials=Materials((250e9, 70e9, 130e9), (0.23, 0.17, 0.28)))
        ),
    }
    for name, moved in cases.items():
        say(
            f"{name}: {280e15 * moved.inwards[0, 0]:.2f} nm, "
            f"f22 − 2 f11 = {on_ledge(film, moved, 280e6) + WHOLE:.0f} Hz"
        )
    return usual


def main() -> None:
    """Print the three tables."""
    device = load("square-270um-perforated")
    moved = convergence(device)
    table = tables(device, moved)
    for below in BELOW[:2]:
        row = table(np.array([[0.9e-6, below, p] for p in (200e6, 250e6, 300e6, 350e6, 400e6)]))
        values = ", ".join(f"{value:.0f}" for value in row)
        say(f"{below * 1e9:.0f} nm from below, oxide at −200 … −400 MPa: {values} Hz")
    draws = expected(table)
    low, high = np.quantile(draws, [0.025, 0.975])
    say(
        f"over what is known: {draws.mean():.0f} ± {draws.std():.0f} Hz, 95 % within "
        f"{low:.0f} … {high:.0f} Hz; {np.mean(draws < 249):.2%} below 249 Hz"
    )
    for line in weigh(draws):
        say(line)


def say(line: str) -> None:
    """Print a line."""
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
