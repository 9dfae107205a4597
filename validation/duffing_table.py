"""Cubic stiffness of ideal membranes with clamped edges."""

from collections.abc import Iterator
from dataclasses import replace

import femnl
from femnl.validation import Case, Reference

# L is the side or the radius, as a part of the outline's length
SHAPES = {"square-270um": 1.0, "circle": 0.5, "hexagon-278um": 0.5}
TABLE = {
    0.23: (10.40502608, 2.885057, 3.629173),
    0.25: (10.50310971, 2.917762, 3.668034),
    0.27: (10.59906238, 2.950014, 3.706262),
    0.30: (10.73893041, 2.997538, 3.762410),
}
# Square, ν = 0.27
HIGHER = {"(2,1)": 82.6425, "(2,2)": 169.194, "(3,1)": 381.712, "(3,3)": 855.955}


def constant(
    name: str, poisson: float, count: int = 1
) -> tuple[dict[str, tuple[float, float]], tuple[float, float]]:
    """C of k₃ = C·Eh/((1−ν²)L²) with its error: by label, and of the first mode."""
    model = replace(femnl.load(name), bending=False)
    model = replace(model, film=replace(model.film, poisson=poisson))
    film = model.film
    length = SHAPES[name] * model.outline.length
    modes = femnl.solve_modes(model, count=count, resolution=2, cache=False)
    found = femnl.solve_nonlinearity(modes, edge="clamped")
    scale = film.young * film.thickness / (1 - poisson**2) / length**2
    values = [
        (k3 / scale, k3 / scale * error / alpha)
        for k3, alpha, error in zip(found.k3, found.alpha, found.alpha_error, strict=True)
    ]
    return {
        label: value for label, value in zip(modes.label, values, strict=True) if label
    }, values[0]


def compute() -> Iterator[tuple[float, float]]:
    """Solve each shape for each ν, then the higher modes of the square."""
    for poisson in TABLE:
        for name in SHAPES:
            yield constant(name, poisson)[1]
    by_label, _ = constant("square-270um", 0.27, 12)
    for label in HIGHER:
        yield by_label[label]


CASE = Case(
    claim="k₃ = C·Eh/((1−ν²)L²) with the constants of series solutions, for square, circle and "
    "hexagon and their "
    "dependence on ν",
    source="in-plane problem of ideal shapes with clamped edges: square by Legendre "
    "polynomials, circle by "
    "quadrature along the "
    "radius, "
    "hexagon by scikit-fem's own elements and forms, all recomputed in "
    "tests/physics/test_references.py; the circle within 0.13 % of "
    "π/(1.27 − 0.97ν − 0.27ν²) of Davidovikj et al., Nat. Commun. 8, 1253 (2017)",
    references=(
        *(
            Reference(f"C, {shape}, ν = {poisson}", value, relative=1e-5)
            for poisson, row in TABLE.items()
            for shape, value in zip(("square", "circle", "hexagon"), row, strict=True)
        ),
        *(
            Reference(f"C, square {label}, ν = 0.27", value, relative=1e-5)
            for label, value in HIGHER.items()
        ),
    ),
    compute=compute,
    slow=True,
)
