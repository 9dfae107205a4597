"""Films drawn by a seed: annuli, single holes, notches and elliptical holes on coarse meshes."""

from collections.abc import Callable, Sequence

import numpy as np

from femnl.core.device import Model
from femnl.device import geometry
from tests.physics.error_battery import FILM, Film, stiff

SIDES = {"square": (0.5, 0.5), "rectangle": (0.7, 0.5), "ellipse": (0.8, 0.5)}
COUNT = 4
SLACK = 0.02  # bending length [m] of films that need one

Kind = Callable[[np.random.Generator], tuple[str, str]]


def hole(x: float, y: float, size: str, clamped: bool) -> str:
    """Return the table of one hole, whose size is a line of it."""
    return (
        f'[[holes]]\nlattice = "list"\ncentres = [["{x} m", "{y} m"]]\n{size}\n'
        f"clamped = {str(clamped).lower()}\n"
    )


def slack(model: Model) -> bool:
    """Whether free rims with straight parts leave hardly any tension beside them, or compression.

    Without bending such a film has no lowest mode: finer elements find ever more beside a slit.
    """
    return any(
        segment.centre is None and not segment.clamped
        for opening in model.openings
        for segment in opening.segments
    )


def drawn(count: int, seed: int, kinds: Sequence[Kind] | None = None) -> list[Film]:
    """Return films of some kinds in turn, with and without bending, of resolutions 0.6 to 1.

    Args: kinds: that draw an outline and its holes; the four of this file if None.
    """
    rng = np.random.default_rng(seed)
    kinds = kinds or (_annulus, _single_hole, _notch, _elliptical_hole)
    found = []
    for k in range(count):
        draw = kinds[k % len(kinds)]
        outline, holes = draw(rng)
        model = geometry.parse(
            f'name = "drawn"\n[outline]\n{outline}\n{holes}\n[film]\n{FILM}\n'
            "[model]\nbending = false"
        )
        # Free edges and holes leave compression, which a film without bending cannot bear
        ends_free = not all(segment.clamped for segment in model.outline.segments)
        if rng.random() < 0.3 or ends_free:
            model = stiff(model, rng.uniform(0.01, 0.05))
        elif slack(model):
            model = stiff(model, SLACK)
        resolution = float(rng.choice([0.6, 0.8, 1.0]))
        found.append(Film(f"{draw.__name__}, {k}", model, resolution, count=COUNT))
    return found


def _annulus(rng: np.random.Generator) -> tuple[str, str]:
    size = f'radius = "{0.5 * rng.uniform(0.03, 0.92):.4g} m"'
    return 'kind = "circle"\ndiameter = "1 m"', hole(0, 0, size, bool(rng.random() < 0.3))


def _outline(rng: np.random.Generator) -> tuple[str, float, float]:
    kind = str(rng.choice(list(SIDES)))
    half_width, half_height = SIDES[kind]
    sides = f'width = "{2 * half_width} m"\nheight = "{2 * half_height} m"'
    if kind == "square":
        sides = 'side = "1 m"'
    return f'kind = "{kind}"\n{sides}', half_width, half_height


def _single_hole(rng: np.random.Generator) -> tuple[str, str]:
    """Return a hole in the middle, on the x axis, near the edge or elsewhere."""
    outline, half_width, half_height = _outline(rng)
    radius = float(np.exp(rng.uniform(np.log(0.0015), np.log(0.08))))
    x = half_width * float(rng.uniform(0.1, 0.5))
    edge = half_width - radius * (1 + float(rng.uniform(0.3, 3)))
    y = half_height * float(rng.uniform(0.1, 0.5))
    places = [(0.0, 0.0), (x, 0.0), (edge, 0.0), (x, y)]
    place = places[int(rng.integers(4))]
    size = f'radius = "{radius:.6g} m"'
    x, y = np.round(place, 6)
    return outline, hole(float(x), float(y), size, bool(rng.random() < 0.3))


def _notch(rng: np.random.Generator) -> tuple[str, str]:
    """Return a clamped slit that reaches into a square from its edge."""
    half = float(np.exp(rng.uniform(np.log(0.0025), np.log(0.05))))
    bottom = 0.5 - float(rng.uniform(0.15, 0.7))
    x = float(rng.uniform(-0.2, 0.2))
    corners = [(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (x + half, 0.5), (x + half, bottom)]
    corners += [(x - half, bottom), (x - half, 0.5), (-0.5, 0.5)]
    points = ", ".join(f'["{a:.6g} m", "{b:.6g} m"]' for a, b in corners)
    return f'kind = "polygon"\npoints = [{points}]', ""


def _elliptical_hole(rng: np.random.Generator) -> tuple[str, str]:
    longer = float(rng.uniform(0.08, 0.3))
    shorter = longer * float(rng.uniform(0.2, 0.5))
    angle = int(rng.choice([0, 30, 90]))
    size = f'semi_axes = ["{longer:.4g} m", "{shorter:.4g} m"]\nangle = "{angle} deg"'
    return 'kind = "square"\nside = "1 m"', hole(0, 0.05, size, bool(rng.random() < 0.5))
