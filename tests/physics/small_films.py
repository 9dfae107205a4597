"""Small perforated films and films with close modes: batteries for the error bars."""

from dataclasses import replace

import numpy as np

from femnl.core.device import Model
from femnl.core.outline import Holes, Outline, Segment
from femnl.device import geometry
from tests.physics.error_battery import FILM, Film, outline, pierced, stiff

PITCH = 8.56e-6


def film(
    n_x: int,
    n_y: int,
    margin: float = 6.6e-6,
    radius: float = 0.9e-6,
    bending: bool = True,
    taper: float = 0.0,
) -> Model:
    """Return a rectangle with n_x × n_y holes in the shipped film, tapered if asked for."""
    base = geometry.load("square-270um-perforated")
    half = np.array([n_x, n_y]) * PITCH / 2 + margin
    corners = [(sx * half[0], sy * half[1]) for sx, sy in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    sides = tuple(Segment(a, b) for a, b in zip(corners, corners[1:] + corners[:1], strict=True))
    edge = Outline("rectangle", sides, (2 * half[0], 2 * half[1]), 2 * half.max())
    places = [PITCH * (np.arange(n) - (n - 1) / 2) for n in (n_x, n_y)]
    holes = Holes(np.stack(np.meshgrid(*places), -1).reshape(-1, 2), radius)
    tapered = replace(base.film, taper=taper, taper_length=2e-6 if taper else 0.0)
    return replace(base, outline=edge, holes=holes, bending=bending, film=tapered)


def perforated(count: int, seed: int) -> list[Film]:
    """Return films with few holes of random size and margin.

    Two in three are made of tiles; bending is on and off in turn.
    """
    rng = np.random.default_rng(seed)
    found = []
    for k in range(count):
        tiled = k % 3 < 2
        bending = k % 2 == 0
        n_x, n_y = rng.integers(3 if tiled else 1, 6, 2)
        radius = rng.uniform(0.4e-6, 2.4e-6)
        margin = rng.uniform(2e-6, 10e-6)
        resolution = float(rng.choice([0.8, 1.0, 1.3]))
        model = film(int(n_x), int(n_y), margin, radius, bending)
        if not tiled and rng.random() < 0.5:
            kind = str(rng.choice(["circle", "hexagon", "square"]))
            model = pierced(
                outline(kind),
                rng.uniform(0.02, 0.06),
                reach=int(rng.integers(0, 3)),
                shift=float(rng.choice([0, 0.013])),
            )
            model = stiff(model, rng.uniform(0.005, 0.05)) if bending else model
        # More than that are not put together from tiles
        modes = min(6, len(model.holes.centres) - 4) if tiled else 6
        found.append(
            Film(f"{model.outline.kind}, {n_x} by {n_y}, film {k}", model, resolution, count=modes)
        )
    return found


def rectangle(width: float) -> Model:
    """A film of height 1 m, without bending, whose wave speed is 1 m/s."""
    sides = f'kind = "rectangle"\nwidth = "{width} m"\nheight = "1 m"'
    return geometry.parse(
        'name = "rectangle"\nsource = "a '
        f'test"\n[outline]\n{sides}\n[film]\n{FILM}\n[model]\nbending = false'
    )


def stretched(model: Model, by: float) -> Model:
    """The film with a margin that is wider along x, by a part of the film's width in all."""
    edge = model.outline
    segments = tuple(
        replace(
            s,
            start=(s.start[0] * (1 + by), s.start[1]),
            end=(s.end[0] * (1 + by), s.end[1]),
            centre=None,
        )
        for s in edge.segments
    )
    return replace(model, outline=replace(edge, segments=segments))


def sloped(model: Model, by: float) -> Model:
    """The film with a thickness that grows along x, by a part of it over the outline's length."""
    slope = by * model.film.thickness / model.outline.length
    return replace(model, film=replace(model.film, gradient=(slope, 0.0)))


def squares() -> list[Film]:
    """Return films whose modes (1,3)+(3,1) and (1,3)−(3,1) are close and cannot mix.

    Their meshes have the diagonal mirror.
    """
    bare = outline("square")
    holes = pierced(bare, 0.05)
    arrays = [
        (n, radius, bending)
        for n in (4, 5, 6)
        for radius, bending in ((0.9e-6, True), (0.9e-6, False), (1.6e-6, n % 2 == 0))
    ]
    return [
        *(Film(f"stiff square, {layer}", stiff(bare, layer)) for layer in (0.03, 0.06, 0.1)),
        *(
            Film(f"pierced square, {symmetry}", stiff(holes, 0.02), symmetry=symmetry)
            for symmetry in ("auto", "quarter")
        ),
        *(
            Film(f"{n} by {n}, {radius:g}, {bending}", film(n, n, radius=radius, bending=bending))
            for n, radius, bending in arrays
        ),
    ]


MESHES = (0.7, 0.85, 1.0, 1.2, 1.4)
"""Resolutions of squares that are meshed whole: how two modes couple is the chance of a mesh."""


def skewed() -> list[Film]:
    """Return films whose close modes mix, since film or mesh lacks the diagonal mirror."""
    bare = outline("square")
    return [
        *(Film(f"rectangle, {width}", stiff(rectangle(width), 0.1)) for width in (1.001, 1.0001)),
        *(Film(f"stretched array, {by:g}", stretched(film(4, 4), by)) for by in (1e-3, 1e-4)),
        Film("stretched array without bending", stretched(film(5, 5, bending=False), 1e-4)),
        *(Film(f"slope, {by:g}", sloped(stiff(bare, 0.05), by), 0.8) for by in (0.05, 0.005)),
        Film("sloped array", sloped(film(4, 4), 0.02), 0.8),
        *(
            Film(
                f"square of layer {layer} on a whole mesh, {fine}",
                stiff(bare, layer),
                fine,
                symmetry="full",
            )
            for layer in (0.03, 0.1)
            for fine in MESHES
        ),
    ]
