"""Extensions of free form: smooth changes of every stage, whatever their cause."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from femnl.core.effect import Change, Effect, ParameterSpec, Stage, Values
from femnl.core.operators import WEIGHTS
from femnl.core.stages import (
    Dissipation,
    Equation,
    Fringe,
    Harmonics,
    Lines,
    ModalSystem,
    Motion,
    Oscillator,
    Points,
    Reading,
    Ringing,
    Signal,
)
from femnl.observe.model import MeasurementModel

ORDERS = range(2, 7)
"""Overtones of a fringe, and harmonics of the drive, that are free."""
OTHERS = range(1, 7)
"""Modes that a free shape is made of beside the driven one."""
POWERS = range(1, 4)
"""Powers of the polynomials that a series or a readout may follow."""
LATER = range(2, 5)
"""Powers of time that the gain of a decay and its phase may follow."""
LEAST_RATE = 0.02
"""Rate of a decay of free form, in parts of that of small motion, at least."""
DISPERSIONS = (-1, 1, 2)
"""Powers of frequency of which a dispersion is made."""


def extensions(base_model: MeasurementModel) -> list[Effect]:
    """Return the free forms that suit a problem."""
    return [form for form in (*FORMS, *_series(base_model)) if base_model.kind in form.kinds]


def _form(
    sentence: str, equation: str, specs: tuple[ParameterSpec, ...], changes: Mapping[Stage, Change]
) -> Effect:
    return Effect(
        "free_form",
        equation,
        specs,
        changes,
        "expansion in smooth functions",
        "a description, not a cause",
        sentence,
    )


def _shorter(form: Effect, *parts: tuple[str, str]) -> tuple[Effect, ...]:
    """Return a form and expansions of it with fewer terms.

    Args: parts: for each shorter form its equation, and the names of its parameters in one string.
    """
    absent = dict.fromkeys((spec.name for spec in form.parameters), 0.0)

    def padded(change: Change) -> Change:
        return lambda value, values: change(value, {**absent, **values})

    changes = {stage: padded(change) for stage, change in form.changes.items()}
    found = [form]
    for equation, names in parts:
        kept = tuple(spec for spec in form.parameters if spec.name in names.split())
        found.append(replace(form, equation=equation, parameters=kept, changes=changes))
    return tuple(found)


def _complex(numbers: range, half: float, per: str = "") -> tuple[ParameterSpec, ...]:
    return tuple(
        ParameterSpec(f"{part}{n}", "1", -half, half, scale=per)
        for n in numbers
        for part in ("real", "imag")
    )


def _number(values: Values, n: int) -> complex:
    return complex(values[f"real{n}"], values[f"imag{n}"])


def _load(system: ModalSystem, values: Values) -> ModalSystem:
    """Add Σ m_k φ_k to the mass per area, φ_k the smooth weights, in parts of the film's own."""
    own = system.mass[0, 0] / system.projection.masses[0, 0, 0]
    added = sum(values[name] * system.projection.masses[k] for k, name in enumerate(WEIGHTS) if k)
    return replace(system, mass=system.mass + own * np.asarray(added))


def _tighten(system: ModalSystem, values: Values) -> ModalSystem:
    """Add Σ t_k φ_k to the stress, in parts of the film's own."""
    return system.tensioned(
        x=values["x"],
        y=values["y"],
        bowl=(values["x²"] + values["y²"]) / 2,
        saddle=(values["x²"] - values["y²"]) / 2,
        product=values["xy"],
    )


def _disperse(lines: Lines, values: Values) -> Lines:
    """Change each frequency by powers of its ratio to the lowest."""
    ratio = lines.frequency / lines.frequency.min()
    return replace(
        lines,
        frequency=lines.frequency * (1 + sum(values[f"power{n}"] * ratio**n for n in DISPERSIONS)),
    )


def _force(mode: Oscillator, values: Values) -> Oscillator:
    return replace(
        mode, quintic=mode.quintic + values["quintic"], damping=mode.damping + values["damping"]
    )


def _move(forces: Equation, values: Values) -> Equation:
    return replace(
        forces,
        **{
            name: getattr(forces, name) + values[name]
            for name in ("quadratic", "cubic", "quintic", "damping")
        },
    )


def _distort(signal: Signal, values: Values) -> Signal:
    share = np.abs(signal.voltage) / signal.largest
    return replace(
        signal, voltage=signal.voltage * (1 + sum(_number(values, n) * share**n for n in POWERS))
    )


def _bend(motion: Motion, values: Values) -> Motion:
    others = [j for j in range(len(motion.shapes)) if j != motion.mode]
    added = sum(_number(values, n) * motion.shapes[j] for n, j in zip(OTHERS, others, strict=False))
    return motion.raised(1, motion.swing * added)


def _turn(motion: Motion, values: Values) -> Motion:
    half = np.hypot(motion.x, motion.y).max() or 1.0
    x = motion.x / half
    y = motion.y / half
    added = sum(
        values[name] * power
        for name, power in zip(WEIGHTS[1:], (x, y, x * x, x * y, y * y), strict=True)
    )
    return replace(motion, theta=motion.theta + added)


def _ripple(fringe: Fringe, values: Values) -> Fringe:
    coefficients = np.zeros(max(len(fringe.coefficients), ORDERS.stop), complex)
    coefficients[: len(fringe.coefficients)] = fringe.coefficients
    for n in ORDERS:
        coefficients[n] += _number(values, n) * abs(fringe.coefficients[1])
    return replace(fringe, coefficients=coefficients)


def _gain(harmonics: Harmonics, values: Values) -> Harmonics:
    factor = np.array(
        [1 + _number(values, n) if n in ORDERS else 1 for n in harmonics.harmonic.tolist()]
    )
    return replace(harmonics, values=harmonics.values * factor[:, None])


def _dissipate(mode: Dissipation, values: Values) -> Dissipation:
    """Add Σ c_n Aⁿ to the rate, in parts of that of small motion, A over that at the begin."""
    added = sum(values[f"amplitude{n}"] * np.exp(0.5 * n * mode.level) for n in POWERS)
    return replace(mode, rate=np.maximum(mode.rate + mode.slow * added, LEAST_RATE * mode.slow))


def _read(reading: Reading, values: Values) -> Reading:
    """Multiply the signal by exp Σ c_n tⁿ, t from 0 to 1 over the record."""
    time = reading.time / reading.time.max()
    bent = sum(values[f"power{n}"] * time**n for n in LATER)
    return replace(reading, gain=reading.gain * np.exp(bent))


def _swing(ringing: Ringing, values: Values) -> Ringing:
    """Turn the phase by Σ c_n tⁿ, t from 0 to 1 over the record."""
    time = ringing.time / ringing.time.max()
    angle = sum(values[f"power{n}"] * time**n for n in LATER)
    return replace(ringing, amplitude=ringing.amplitude * np.exp(1j * angle))


def _later(half: float) -> tuple[ParameterSpec, ...]:
    return tuple(ParameterSpec(f"power{n}", "1", -half, half) for n in LATER)


def _smooth(names: range | tuple[str, ...], half: float) -> tuple[ParameterSpec, ...]:
    return tuple(ParameterSpec(str(name), "1", -half, half) for name in names)


_FORCES = (
    ParameterSpec("quintic", "m^-4", -1.0, 1.0, scale="curvature_square"),
    ParameterSpec("damping", "m^-2", -10.0, 10.0, scale="curvature"),
)
_TERMS = (
    ParameterSpec("quadratic", "1/V", -1.0, 1.0, scale="slope"),
    ParameterSpec("cubic", "1/V^2", -1.0, 1.0, scale="curvature"),
    ParameterSpec("quintic", "1/V^4", -1.0, 1.0, scale="curvature_square"),
    ParameterSpec("damping", "1/V^2", -10.0, 10.0, scale="curvature"),
)
MASS = _form(
    "a mass that varies smoothly over the film",
    "ρ → ρ(1 + Σ m_k φ_k)",
    _smooth(WEIGHTS[1:], 0.3),
    {"operators": _load},
)
TENSION = _form(
    "a tension that varies smoothly over the film",
    "σ → σ(1 + Σ t_k φ_k)",
    _smooth(WEIGHTS[1:], 0.3),
    {"operators": _tighten},
)
FORCES = _form(
    "restoring and damping forces of free form",
    "κ₂u², αu³, α₅u⁵, ηu²u̇ of any sign",
    _TERMS,
    {"equation": _move},
)
FRINGE = _form(
    "a fringe of free form", "c_k free, k = 2 … 6", _complex(ORDERS, 1.0), {"fringe": _ripple}
)
FORMS = (
    *_shorter(MASS, ("ρ → ρ(1 + m_x x + m_y y)", "x y")),
    *_shorter(TENSION, ("σ → σ(1 + t_x x + t_y y)", "x y")),
    *_shorter(
        _form(
            "a dispersion of free form",
            "f → f(1 + Σ d_n (f/f₁)ⁿ), n = −1, 1, 2",
            tuple(ParameterSpec(f"power{n}", "1", -0.3, 0.3) for n in DISPERSIONS),
            {"frequencies": _disperse},
        ),
        *((f"f → f(1 + d (f/f₁)^{n})", f"power{n}") for n in DISPERSIONS),
    ),
    *_shorter(
        _form(
            "restoring and damping forces of free form",
            "α₅u⁵, ηu²u̇ of any sign",
            _FORCES,
            {"oscillator": _force},
        ),
        ("α₅u⁵ of any sign", "quintic"),
        ("ηu²u̇ of any sign", "damping"),
    ),
    FORCES,
    *_shorter(
        _form(
            "a damping that varies with amplitude",
            "γ → γ(1 + Σ c_n Aⁿ), n = 1, 2, 3",
            tuple(ParameterSpec(f"amplitude{n}", "1", -30.0, 30.0) for n in POWERS),
            {"dissipation": _dissipate},
        ),
        ("γ → γ(1 + c A)", "amplitude1"),
        ("γ → γ(1 + c A²)", "amplitude2"),
    ),
    *_shorter(
        _form(
            "a gain that varies smoothly with time",
            "V → V exp Σ c_n tⁿ, n = 2, 3, 4",
            _later(20.0),
            {"reading": _read},
        ),
        ("V → V exp c t²", "power2"),
    ),
    *_shorter(
        _form(
            "a frequency that varies smoothly with time",
            "φ → φ + Σ c_n tⁿ, n = 2, 3, 4",
            _later(1000.0),
            {"ringing": _swing},
        ),
        ("φ → φ + c t²", "power2"),
    ),
    *_shorter(
        _form(
            "a readout of free form",
            "V → V(1 + Σ c_n (|V|/V_max)ⁿ), c complex",
            _complex(POWERS, 3.0),
            {"signal": _distort},
        ),
        ("V → V(1 + c (|V|/V_max)²), c real", "real2"),
        ("V → V(1 + c (|V|/V_max)²), c complex", "real2 imag2"),
    ),
    _form(
        "a shape of free form",
        "ξ → ξ + Σ e_j ξ_j, e complex",
        _complex(OTHERS, 0.3),
        {"motion": _bend},
    ),
    _form(
        "a phase of the fringe that varies smoothly",
        "θ → θ + quadratic in x, y",
        _smooth(WEIGHTS[1:], 3.0),
        {"motion": _turn},
    ),
    FRINGE,
    _form(
        "a gain of each harmonic",
        "V_n → (1 + g_n) V_n, g complex",
        _complex(ORDERS, 5.0),
        {"harmonics": _gain},
    ),
)


def _series(base_model: MeasurementModel) -> list[Effect]:
    """Return a cubic of frequency and of 1/Q in each control variable that was varied."""
    return [_against(control) for control in base_model.varied]


def _against(control: str) -> Effect:
    def follow(points: Points, values: Values) -> Points:
        axis = points.control[control]
        unit = 2 * (axis - axis.min()) / max(float(np.ptp(axis)), 1e-300) - 1
        pull, loss = (
            1 + sum(values[f"{name}{n}"] * unit**n for n in POWERS) for name in ("pull", "loss")
        )
        return replace(
            points,
            frequency=points.frequency * pull,
            quality_factor=points.quality_factor / np.maximum(loss, 1e-3),
        )

    specs = tuple(
        ParameterSpec(f"{name}{n}", "1", -half, half)
        for name, half in (("pull", 0.1), ("loss", 1.0))
        for n in POWERS
    )
    quantity = control.replace("_", " ")
    return _form(
        f"a cubic dependence on {quantity}",
        f"f and 1/Q cubic in {quantity}",
        specs,
        {"points": follow},
    )
