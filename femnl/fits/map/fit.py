"""Fits of harmonic maps: motion in metres, fringe and placement, from all harmonics at once."""

from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr

from femnl.core.errors import MeasurementError, ParameterError
from femnl.core.fit import Fit, MapFit, Parameter
from femnl.core.readout import Array, PeriodicFringe
from femnl.fits.covariance import strongest_correlation
from femnl.fits.map.equal_solutions import canonical, wrap
from femnl.fits.map.residuals import MapResiduals
from femnl.observe.map.forward import REGISTRATION, UNITS, MapData, Shape, flatten

MIRRORS = {"−θ": (-1, 0.0), "π − θ": (-1, np.pi)}
"""The other working points of one cosine with the same |sin θ| and |cos θ|, as sign and shift; the
third is both at once.
"""
FARTHEST = 1e-4
"""Amplitude [m] beyond which the fringes that a motion passes take the memory of a machine."""
FIRST = 8
"""Evaluations that every optimum of the coarse search gets before the best two go on."""
SAME = 1.0
"""Difference in χ² below which two solutions count as the same to the data."""
TELLING = 9.0
"""Difference in χ² (3σ) from which on one solution is said to be preferred."""


def fit_map(
    maps: xr.Dataset | Mapping[str, xr.Dataset],
    shape: Shape,
    fringe: PeriodicFringe | Mapping[str, PeriodicFringe] | None = None,
    registration: Sequence[str] = REGISTRATION,
    free_overtones: int = 1,
    fixed: Mapping[str, float] | None = None,
) -> MapFit:
    """Fit measured harmonic maps by a membrane that moves as U ξ(x, y) cos(ωt + φ) under a fringe.

    V_n(x, y) = V_C e^{inφ} Σ_k 2Re(c_k iⁿ e^{ikθ}) J_n(kqUξ), q = 4π/λ; one cosine (c₁ = 1) unless
    a fringe is given. Real and imaginary parts of all harmonics count alike; missing points are
    left out. U is sought on a grid up to z = 30 and the best optima are refined together with
    everything else, so that no start value is asked for.

    Args:
        maps: one Dataset of kind `map`, or several by name, which share U and nothing else.
        shape: ξ at points (x, y) [m]; max|ξ| = 1.
        fringe: the fringe of a single map, or of each map by name; its offset, its scale and its
            working point do not matter.
        registration: which of x, y [m], scale, rotation [rad] of the membrane in the map are free;
            the others stay at 0, 0, 1, 0.
        free_overtones: highest overtone of the fringe that is fitted; 1 takes the fringe as given,
            more lets its form be found.
        fixed: values by parameter name, SI, which are held.

    Returns:
        The fit. Parameters: `amplitude` U [m]; per map `contrast` V_C [V], `fringe_phase` θ,
        `motion_phase` φ [rad] and the free placement; derived: `modulation` S′ = qU, and
        `working_point` [m], by how much the film rests away from where the fringe as given has u =
        0. With several maps a name carries ":" and that of the map. Free overtones are
        `overtone_k_real`, `overtone_k_imag`: what is added to c_k, relative to c₁. For one cosine
            V_C > 0 and sin θ ≥ 0; for a symmetric fringe that is given, the nearer of ±θ, unless a
            parameter is held. The notes say what stays open.

    Raises:
        MeasurementError: a map without values or without a wavelength.
        ParameterError: unknown names in `registration`, `fringe` or `fixed`, or more parameters
            than data.

    Valid: motion sinusoidal in time; a laser spot small against the rings; z below 30.
    Source: Sommer et al. 2025, supplement S7; variable projection: Golub & Pereyra, SIAM J. Numer.
    Anal. 10, 413 (1973).
    """
    named = {"": maps} if isinstance(maps, xr.Dataset) else dict(maps)
    flat = [flatten(name, named[name], of) for name, of in _fringes(named, fringe).items()]
    problem = MapResiduals(
        flat,
        shape,
        tuple(registration),
        tuple(range(2, free_overtones + 1)),
        _checked(fixed or {}),
    )
    if unknown := set(registration) - set(REGISTRATION):
        raise ParameterError(
            f"registration = {sorted(unknown)} is not known: choose from {', '.join(REGISTRATION)}"
        )
    held = problem.held
    coarse = problem.tabulated()
    starts = coarse.starts()
    _need_data(coarse.residuals(starts[0]).size, int(held.free.sum()))
    optima = sorted(
        (coarse.refine(start, most=FIRST) for start in starts),
        key=lambda optimum: optimum[1],
    )
    optima[:2] = [coarse.refine(vector) for vector, _ in optima[:2]]
    best = min(optima, key=lambda optimum: optimum[1])
    rivals = [
        _rival(coarse, canonical(coarse, best[0]), best[1], i, name)
        for i in range(len(named))
        if held.free[_of_phase(problem, i)]
        for name in MIRRORS
    ]
    vector = canonical(problem, problem.refine(best[0])[0])
    other = [_next_amplitude(optima, best)] if held.free[0] else []
    return _report(problem, vector, (*rivals, *other))


def _need_data(count: int, parameters: int) -> None:
    if count < parameters:
        raise MeasurementError(
            f"maps: {count} numbers that are no gaps, for {parameters} parameters; give more "
            "pixels or harmonics, or hold parameters"
        )


def _checked(fixed: Mapping[str, float]) -> Mapping[str, float]:
    """Return what is held.

    Raises: ParameterError for a motion or a contrast of 0, and for a motion through fringes without
    number.
    """
    for name, value in fixed.items():
        if name.partition(":")[0] in ("amplitude", "contrast") and value == 0:
            raise ParameterError(f"fixed: {name} = 0: gives no signal; give another value")
        if name == "amplitude" and abs(value) > FARTHEST:
            raise ParameterError(
                f"fixed: amplitude = {value:g} m: no film is read as far as {FARTHEST:g} m; give "
                "its amplitude in m, or with its unit"
            )
    return fixed


def _of_phase(problem: MapResiduals, which: int) -> int:
    """Return the index of θ of a map in the parameter vector."""
    return 1 + which * len(problem.own) + problem.own.index("fringe_phase")


def _fringes(
    named: Mapping[str, xr.Dataset], fringe: PeriodicFringe | Mapping[str, PeriodicFringe] | None
) -> dict[str, PeriodicFringe | None]:
    """Return the fringe of each map, None for one cosine."""
    if fringe is None:
        return dict.fromkeys(named)
    if not isinstance(fringe, Mapping):
        fringe = {next(iter(named)): fringe}
    if set(fringe) != set(named):
        raise ParameterError(
            f"fringe is given for {sorted(fringe)}, but the maps are {sorted(named)}: name each "
            "map once"
        )
    return {name: fringe[name] for name in named}


def _label(name: str, data: MapData) -> str:
    return f"{name}:{data.name}" if data.name else name


def _rival(problem: MapResiduals, vector: Array, chi2: float, which: int, mirror: str) -> str:
    """Say what another working point of the same V_C, |sin θ| and |cos θ| costs.

    Everything else is adapted to it.
    """
    sign, shift = MIRRORS[mirror]
    trials = []
    for quarter in range(4):
        turned = problem.unpack(vector)
        turned[which]["fringe_phase"] = sign * turned[which]["fringe_phase"] + shift
        turned[which]["motion_phase"] += quarter * np.pi / 2
        trials.append(problem.held.put(problem.pack(vector[0], turned)))
    nearest = min(trials, key=lambda trial: float(np.sum(problem.residuals(trial) ** 2)))
    first = 1 + which * len(problem.own)
    excess = float(np.sum(problem.residuals(nearest) ** 2)) - chi2
    if excess >= SAME:
        excess = problem.refine(nearest, held=(first, first + 1), most=2 * FIRST)[1] - chi2
    where = f" of {problem.maps[which].name}" if problem.maps[which].name else ""
    if excess < SAME:
        return (
            f"θ{where} is indistinguishable from {mirror}: with the phase of motion adapted it "
            f"costs Δχ² = {max(excess, 0):.2g}"
        )
    relation = "preferred to" if excess > TELLING else "hardly distinguishable from"
    return f"θ{where} is {relation} {mirror}, which costs Δχ² = {excess:.3g}"


def _next_amplitude(optima: list[tuple[Array, float]], best: tuple[Array, float]) -> str:
    """Say how well the best optimum with another U fits."""
    others = [
        (chi2, abs(vector[0]))
        for vector, chi2 in optima
        if abs(abs(vector[0] / best[0][0]) - 1) > 1e-2
    ]
    if not others:
        return "no second optimum of the amplitude was met"
    chi2, amplitude = min(others)
    return f"the next best amplitude is {amplitude * 1e9:.2f} nm, Δχ² = {chi2 - best[1]:.3g}"


def _report(problem: MapResiduals, vector: Array, notes: tuple[str, ...]) -> MapFit:
    """Put values, uncertainties, prediction and notes together."""
    keys = [
        ("amplitude", "amplitude"),
        *((_label(name, data), name) for data in problem.maps for name in problem.own),
    ]
    names = [key for key, _ in keys]
    held = problem.held
    n_free = int(np.count_nonzero(held.free))
    degrees = problem.n_points - n_free
    if degrees <= 0:
        raise ParameterError(
            f"{n_free} parameters cannot be fitted to {problem.n_points} numbers: fix some "
            "of `registration`"
        )
    residuals = problem.residuals(vector)
    chi2_reduced = float(residuals @ residuals) / degrees
    found, blind = held.covariance(problem.jacobian(vector), problem.unit(vector))
    if not all(data.noise_known for data in problem.maps):
        found = found * chi2_reduced
        notes = (*notes, "without noise_sd the uncertainties are scaled to χ²/dof = 1")
    sd = np.sqrt(np.diag(found))
    parameters = {
        label: Parameter(label, float(value), float(s), UNITS.get(name, "1"))
        for (label, name), value, s in zip(keys, vector, sd, strict=True)
    }
    for data in problem.maps:
        theta = parameters[_label("fringe_phase", data)]
        parameters |= _derived(data, parameters["amplitude"], theta)
    predictions = list(zip(problem.maps, problem.predictions(vector), strict=True))
    remarks = (
        *(data.note for data in problem.maps),
        *held.notes,
        *blind,
        strongest_correlation(found, names),
        *notes,
    )
    return MapFit(
        Fit(
            held.ordered(parameters),
            held.inner(found),
            chi2_reduced,
            problem.n_points,
            n_free,
            tuple(note for note in remarks if note),
        ),
        {data.name: data.image(signal) for data, signal in predictions},
        {
            data.name: data.image((data.values - signal) / data.noise)
            for data, signal in predictions
        },
    )


def _derived(data: MapData, amplitude: Parameter, theta: Parameter) -> dict[str, Parameter]:
    """Return the modulation z = qU of a map, and the displacement [m] of its working point."""
    q = data.wavenumber
    shift = wrap(theta.value - (data.nominal or 0.0)) / q
    listed = (
        Parameter(_label("modulation", data), q * amplitude.value, q * amplitude.sd, "1"),
        Parameter(_label("working_point", data), shift, theta.sd / q, "m"),
    )
    return {one.name: one for one in listed}
