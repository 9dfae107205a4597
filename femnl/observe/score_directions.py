"""What may deviate whatever the cause, in films, forces and fringes.

The stages that make them, changed a little in free form.
"""

from collections.abc import Sequence

import numpy as np

from femnl.core.effect import Effect, ParameterSpec, Values
from femnl.core.readout import Array
from femnl.core.stages import Motion
from femnl.observe.free_forms import FORCES, FRINGE, MASS, TENSION
from femnl.observe.model import MeasurementModel, scale_of

LITTLE = 1e-3
"""Size of the changes, in parts of their range, at which residuals answer in proportion."""
UNEVEN = {
    "x": (1, 0),
    "y": (0, 1),
    "x²": (2, 0),
    "xy": (1, 1),
    "y²": (0, 2),
    "x³": (3, 0),
    "x²y": (2, 1),
    "xy²": (1, 2),
    "y³": (0, 3),
}
"""Smooth functions of the place."""


def smooth_film(
    base_model: MeasurementModel, effects: Sequence[Effect], base: Values, values: Sequence[Values]
) -> dict[str, Array]:
    """Return how residuals answer to a mass and a tension that vary over the film.

    A phrase names the dependence of each on the place.
    """
    found: dict[str, Array] = {}
    for what, form in (("mass", MASS), ("tension", TENSION)):
        names = {spec.name: f"{what} that varies as {spec.name}" for spec in form.parameters}
        found |= _answers(base_model, form, names, effects, base, values)
    return found


def forces(
    base_model: MeasurementModel, effects: Sequence[Effect], base: Values, values: Sequence[Values]
) -> dict[str, Array]:
    """Return how residuals answer to restoring and damping forces of higher order."""
    names = {
        "quadratic": "force as u²",
        "cubic": "force as u³",
        "quintic": "force as u⁵",
        "damping": "damping as u²",
    }
    return _answers(base_model, FORCES, names, effects, base, values)


def fringe_terms(
    base_model: MeasurementModel, effects: Sequence[Effect], base: Values, values: Sequence[Values]
) -> dict[str, Array]:
    """Return how residuals answer to terms of the fringe beyond the first, by what they are."""
    waves = {"real": "cos", "imag": "sin"}
    names = {
        spec.name: f"term {waves[spec.name[:-1]]} {spec.name[-1]}φ of the fringe"
        for spec in FRINGE.parameters
    }
    return _answers(base_model, FRINGE, names, effects, base, values)


def overtones(
    base_model: MeasurementModel, effects: Sequence[Effect], base: Values, values: Sequence[Values]
) -> dict[str, Array]:
    """Return how residuals answer to motion at 2 and 3 times the drive, by order and phase.

    The motion is the same all over the film.
    """
    names = {
        spec.name: f"{spec.name[:-1]} motion at {spec.name[-1]}f" for spec in OVERTONES.parameters
    }
    return _answers(base_model, OVERTONES, names, effects, base, values)


def uneven(x: Array, y: Array) -> dict[str, Array]:
    """Return the smooth functions `UNEVEN` of places (n,), by name, that vary over them.

    x and y run from −1 to 1.
    """
    u, v = ((2 * c - c.min() - c.max()) / (np.ptp(c) or 1.0) for c in (x, y))
    found = {name: u**p * v**q for name, (p, q) in UNEVEN.items()}
    return {name: factor for name, factor in found.items() if np.ptp(factor)}


def _answers(
    base_model: MeasurementModel,
    form: Effect,
    names: dict[str, str],
    effects: Sequence[Effect],
    base: Values,
    values: Sequence[Values],
) -> dict[str, Array]:
    zero = dict.fromkeys(names, 0.0)
    plain = base_model.residuals(effects, base, values)
    sizes = {spec.name: LITTLE * spec.high * scale_of(base_model, spec) for spec in form.parameters}
    return {
        name: base_model.residuals((*effects, form), base, [*values, zero | {spec: sizes[spec]}])
        - plain
        for spec, name in names.items()
    }


def _sing(motion: Motion, values: Values) -> Motion:
    size = np.abs(motion.swing)
    turn = motion.swing / np.where(size > 0, size, 1.0)
    for n in (2, 3):
        motion = motion.raised(
            n, (values[f"cos{n}"] - 1j * values[f"sin{n}"]) * size.max() * turn**n
        )
    return motion


OVERTONES = Effect(
    "overtones",
    "u → u + U Σ_n (a_n cos nτ + b_n sin nτ), n = 2, 3, everywhere",
    tuple(ParameterSpec(f"{wave}{n}", "1", -1.0, 1.0) for n in (2, 3) for wave in ("cos", "sin")),
    {"motion": _sing},
    "expansion in a Fourier series",
    "a description, not a cause",
    "motion at multiples of the drive",
)
