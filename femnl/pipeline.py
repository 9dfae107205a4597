"""The order of the stages.

From a device to its modes, their nonlinearity and what the readout shows of them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from femnl.core.choices import Certified
from femnl.core.device import Edge, Model
from femnl.core.errors import ConvergenceError, MeasurementError, ParameterError
from femnl.core.modes import Modes
from femnl.core.nonlinearity import Nonlinearity
from femnl.core.processes import one_blas_thread
from femnl.core.readout import Array, HarmonicMap
from femnl.device.geometry import load, load_shipped, parse
from femnl.io.results.cache import cached_modes, cached_nonlinearity

if TYPE_CHECKING:
    from femnl.optics.harmonics import Fringe

DEGREE = 4
COARSE = 0.6  # resolution from which a tolerance is approached
STEP = 8.0  # by which an error has to fall for a higher degree to pay, rather than smaller elements
# Coarse modes beyond those asked for, so that the highest fine ones find their counterparts
SPARE = 4
GRID = 101
MARGIN = 0.1


def measured_device(
    attributes: Mapping[Any, Any], path: Path, geometry: str | None = None
) -> Model:
    """The device of a measurement file.

    The one asked for, else the file's attribute `model`, else the name or path in `geometry`.

    Args: attributes: of the file's root. path: of the file, from which a relative path counts.
    geometry: a name or path.
    Raises: GeometryError; MeasurementError where the file says nothing of its device, or names a
    file outside its own folder.
    """
    if geometry is not None:
        return load(geometry)
    if "model" in attributes:
        return parse(str(attributes["model"]), f"{path}: model")
    if "geometry" not in attributes:
        raise MeasurementError(
            f"{path}: names no geometry; give one with --geometry, or set the file's attribute "
            "geometry"
        )
    named = str(attributes["geometry"])
    if not named.endswith(".toml"):
        return load_shipped(named)
    beside = (path.parent / named).resolve()
    if not beside.is_relative_to(path.parent.resolve()):
        raise MeasurementError(
            f"{path}: geometry {named!r} leaves the file's folder; put the geometry beside it, "
            "or give it with --geometry"
        )
    return load(beside)


def solve_modes(
    model: Model,
    count: int = 10,
    symmetry: str = "auto",
    resolution: float = 1.0,
    cache: bool = True,
    degree: int = DEGREE,
    *,
    tell: bool = True,
) -> Modes:
    """Solve the modes of a device.

    Mesh, relaxed film stress, prestressed modes, and the same at lower degrees to estimate
    errors.

    Args: count: how many, by rising frequency. symmetry, resolution: of the mesh, see
        `femnl.device.mesh.mesh`; where symmetry is `auto`, a rectangle with a rectangular array of
        holes is put together from condensed cells. degree: of the elements.
        cache: take an earlier solution of the same device, options and code from disk, and keep
            this one there. tell: whether to say how far layers bend the film at rest; not where
            that is said elsewhere.
    Returns: Modes with `coarse`, the solution of one degree less, which has that of two where it
        exists, and so with `frequency_error`, `ratio_error` and `effective_mass_error`. Meshes that
        are too coarse to tell the errors of all modes are refined.
    Raises: ParameterError, GeometryError; ConvergenceError, also where errors stay unknown.
    """

    def at_resolution(finer: float) -> Modes:
        from femnl.mechanics.modes import with_counterparts

        road = _road(model, symmetry, finer, count, degree)
        return with_counterparts(model, road, count, SPARE, degree)

    options = (count, symmetry, resolution, degree)
    return _alone(model, options, at_resolution, resolution, cache, tell)


def solve_release(model: Model, symmetry: str = "auto", resolution: float = 1.0) -> Modes:
    """Mesh a device and relax its film stress, and solve no mode.

    So that a film which buckles, and has no modes, can be looked at.

    Args: symmetry, resolution: as in `solve_modes`.
    Returns: Modes of which there are none.
    Raises: ParameterError, GeometryError; ConvergenceError where the film is not supported.
    """
    from femnl.device.mesh import mesh
    from femnl.mechanics.modes import without_modes
    from femnl.mechanics.prestress import solve_prestress

    with one_blas_thread():
        return without_modes(solve_prestress(mesh(model, symmetry, resolution, DEGREE), DEGREE))


def solve_modes_near(
    model: Model,
    frequency: float,
    count: int = 10,
    symmetry: str = "auto",
    resolution: float = 1.0,
    cache: bool = True,
) -> Modes:
    """Solve the modes of a device nearest to a frequency, without those below them.

    Args: frequency: the target [Hz]. count: how many, on both sides of it. symmetry, resolution,
        cache: as in `solve_modes`.
    Returns: Modes as of `solve_modes`, by rising frequency; `first` is the number of the lowest
        among all modes of the film. They tell no f/f₁.
    Raises: ParameterError, GeometryError, ConvergenceError.
    """

    def at_resolution(finer: float) -> Modes:
        from femnl.device.mesh import mesh, wave_at
        from femnl.mechanics.modes import degrees_at_once, with_counterparts
        from femnl.mechanics.modes import solve_modes_near as solve_on_mesh
        from femnl.mechanics.prestress import solve_prestress

        wave = wave_at(model, frequency) if frequency > 0 else np.inf
        domain = mesh(model, symmetry, finer, DEGREE, wave)

        def at_degree(number: int, degree: int) -> Modes:
            # Buckling shows at each degree: it is looked for once, where that is cheap and sure
            stable = degree != DEGREE - 1
            prestress = solve_prestress(domain, degree)
            return solve_on_mesh(prestress, frequency, number, degree, stable)

        # Counterparts may lie beyond either end
        threads = degrees_at_once(domain, DEGREE)
        return with_counterparts(model, at_degree, count, 2 * SPARE, DEGREE, threads)

    options = ("near", frequency, count, symmetry, resolution, DEGREE)
    return _alone(model, options, at_resolution, resolution, cache)


def _alone(
    model: Model,
    options: tuple[object, ...],
    at_resolution: Callable[[float], Modes],
    resolution: float,
    cache: bool,
    tell: bool = True,
) -> Modes:
    """Take modes from the cache or solve them, on one thread.

    Args: at_resolution: solves them at a resolution, or at a higher one than asked for. tell:
        whether to say how far layers bend the film at rest.
    """
    from femnl.mechanics.compression import say_what_is_compressed
    from femnl.mechanics.fem.offset import say_what_bends

    model.refuse_contradictions()

    def solve_alone() -> Modes:
        from femnl.mechanics.modes import certified

        with one_blas_thread():
            return certified(model, at_resolution, resolution)

    found = cached_modes(model, options, solve_alone) if cache else solve_alone()
    if tell:
        say_what_bends(model)  # of modes that there are: a refusal is one line
    say_what_is_compressed(found)
    return found


def _road(
    model: Model, symmetry: str, resolution: float, count: int, highest: int
) -> Callable[[int, int], Modes]:
    """The solution for a number of modes and a degree up to the highest.

    In condensed tiles where the device has them, else on one mesh.
    """
    from femnl.device.mesh import mesh, shortest_wave
    from femnl.mechanics.lattice import obstacle, solve_condensed, tile
    from femnl.mechanics.modes import solve_modes as solve_on_mesh
    from femnl.mechanics.prestress import solve_prestress

    if symmetry == "auto" and count + SPARE <= len(model.holes.centres) and not obstacle(model):
        return partial(solve_condensed, tile(model, resolution))
    domain = mesh(model, symmetry, resolution, highest, shortest_wave(model, count))
    return lambda count, degree: solve_on_mesh(solve_prestress(domain, degree), count, degree)


def solve_modes_to(
    model: Model,
    tolerance: float,
    count: int = 10,
    symmetry: str = "auto",
    cache: bool = True,
    of: Certified = "frequency",
) -> Modes:
    """Modes of a device whose numbers are known within a relative tolerance.

    Degree and mesh follow from the error bars.

    A higher degree comes first, then smaller elements everywhere: at corners, clamped edges and
    holes most of all.

    Args: tolerance: of f and f/f₁ of every mode, 2e-11 to 0.1. count, symmetry, cache: as in
        `solve_modes`. of: "all" asks the same of m_eff, k₃ and α.
    Raises: ParameterError; ConvergenceError that says how far it came and what stopped it.
    """
    if not 2e-11 <= tolerance <= 0.1:
        raise ParameterError(
            f"tolerance = {tolerance:g}: expected a relative error from 2e-11, where rounding "
            "sets in, to 0.1"
        )
    from femnl.mechanics.fem.elements import DEGREES

    degree = DEGREE
    resolution = COARSE
    best = np.inf
    earlier = None
    while True:
        try:
            modes = solve_modes(model, count, symmetry, resolution, cache, degree)
        except ParameterError as error:
            if not np.isfinite(best):
                raise
            raise ConvergenceError(
                f"tolerance = {tolerance:g}: stopped at a relative error of {best:.1e}, "
                f"because {error}"
            ) from error
        errors = _relative_errors(modes, of, cache)
        worst = int(np.argmax(errors))
        excess = float(errors[worst]) / tolerance
        if excess <= 1:
            return modes
        stuck = errors[worst] > 0.8 * best
        if stuck and degree == DEGREES[-1]:
            # Where rounding rules, a bar is small by luck: by how much the last mesh moved the
            # frequencies is not.
            moved = 0.0 if earlier is None else float(np.abs(modes.frequency / earlier - 1).max())
            raise ConvergenceError(
                f"tolerance = {tolerance:g}: stopped at a relative error of "
                f"{max(best, moved):.1e} (mode {worst + 1}), which degree {degree} at resolution "
                f"{resolution:.3g} no longer lowers; ask for no more than that"
            )
        best = min(best, float(errors[worst]))
        earlier = modes.frequency
        if (stuck or excess > STEP) and degree < DEGREES[-1]:
            degree += 1
        else:
            resolution *= float(np.clip(1.1 * excess ** (1 / (2 * degree - 2)), 1.3, 2.0))


def _relative_errors(modes: Modes, of: Certified, cache: bool) -> Array:
    """The largest relative error bar of each mode."""
    bars = [modes.frequency_error / modes.frequency, modes.ratio_error / modes.ratio]
    if of == "all":
        found = solve_nonlinearity(modes, cache=cache)
        bars += [
            modes.effective_mass_error / modes.effective_mass,
            found.k3_error / found.k3,
            found.alpha_error / found.alpha,
        ]
    return np.asarray(np.max(bars, axis=0))


def solve_nonlinearity(
    modes: Modes, edge: Edge | None = None, tensor: bool = False, cache: bool = True
) -> Nonlinearity:
    """Geometric Duffing coefficients k₃ and α of the modes.

    The in-plane edge is the model's unless one is given.

    Args, Returns, Source: see `femnl.mechanics.nonlinearity.solve_nonlinearity`. cache: as in
    `solve_modes`.
    """
    chosen = edge or modes.domain.model.edge

    def solve() -> Nonlinearity:
        from femnl.mechanics import nonlinearity
        from femnl.mechanics.lattice import strain_energies

        energies = partial(strain_energies, edge=chosen) if modes.domain.tiles else None
        with one_blas_thread():
            return nonlinearity.solve_nonlinearity(modes, chosen, tensor, energies)

    found = cached_nonlinearity(modes, chosen, tensor, solve) if cache else solve()
    return replace(found, first=modes.first)


def harmonic_maps(
    modes: Modes,
    index: int,
    fringe: Fringe,
    amplitude: float,
    wavelength: float,
    *,
    harmonics: int = 6,
    points: int = GRID,
) -> HarmonicMap:
    """Return maps V_n(x, y) of harmonics 1…n of the drive when one mode moves.

    By `amplitude` [m] where |ξ| = 1.

    Args: index: 0 for the fundamental mode. fringe: f(u), u [m] → v [V]. wavelength: of the laser
        [m], recorded with the map. points: along each axis of a square grid that covers the film
        and a tenth more on every side.
    Returns: complex amplitudes, v(t) = Σ_n Re(V_n e^{inωt}), without noise.
    """
    from femnl.mechanics.modes import shape_at
    from femnl.optics.harmonics import harmonic_map

    domain = modes.domain
    corners = np.array([s.start for s in domain.model.outline.segments]) - domain.middle
    met = domain.mesh.p.T - domain.middle
    reach = max(np.abs(corners).max(), np.abs(met).max()) * (1 + 2 * MARGIN)
    x, y = (place + np.linspace(-reach, reach, points) for place in domain.middle)
    shape = shape_at(modes, index, x[None, :], y[:, None])
    return harmonic_map(
        fringe,
        np.arange(1, harmonics + 1),
        shape,
        amplitude,
        x=x,
        y=y,
        wavelength=wavelength,
    )
