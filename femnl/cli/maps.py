"""`femnl maps GEOMETRY`: what the readout shows of one moving mode."""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import femnl
from femnl.cli._device import Bending, Cache, Geometry, check_mode, load_device, suffix_of
from femnl.cli._output import note
from femnl.core.errors import ParameterError
from femnl.core.memory import need_memory
from femnl.io.measurement.units import quantity
from femnl.io.results.atomic import need_room, write_whole

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from femnl.core.device import Model
    from femnl.optics.harmonics import Fringe

FRINGES = ("sine", "multilayer")
HELD = 140.0
"""Bytes for each harmonic at each point: half more than the 94 that were measured, between 501 and
801 points along each axis, with 20 harmonics of a sine and noise; the stack takes 54.
"""
OWN = 2**29
"""Bytes that the command takes for a few points: its libraries, modes, a figure."""
LARGEST_Z = 1000  # the amplitude is then 80 wavelengths, and no film moves so far

Z = Annotated[float, typer.Option("--z", help="Modulation z = 4πU/λ at the antinode.")]
Wavelength = Annotated[str, typer.Option(help='Of the laser, with its unit: "632.8 nm".')]
Shown = Annotated[int, typer.Option(help="How many harmonics of the drive.", min=1, max=50)]
Theta = Annotated[
    float | None,
    typer.Option(help="Working point θ of the sine fringe, in rad.", show_default="π/4"),
]
Readout = Annotated[
    str,
    typer.Option(
        "--fringe", help="sine, or multilayer for the reflection of the geometry's stack."
    ),
]
Noise = Annotated[
    str | None,
    typer.Option(
        help='Noise to add to each quadrature, as a standard deviation with its unit: "0.3 mV".',
        show_default=False,
    ),
]
Seed = Annotated[
    int | None, typer.Option(help="Of that noise.", min=0, max=2**63, show_default="1")
]
Points = Annotated[int, typer.Option(help="Points along each axis of the map.", min=3, max=2001)]
Out = Annotated[
    Path | None,
    typer.Option(
        help="Measurement file to write; the figure beside it as .png.",
        show_default="GEOMETRY-mode-MODE-maps.nc",
    ),
]


def command(
    geometry: Geometry,
    z: Z,
    *,
    mode: Annotated[int, typer.Option(help="Which mode, from 1.")] = 1,
    wavelength: Wavelength = "632.8 nm",
    harmonics: Shown = 6,
    fringe: Readout = "sine",
    theta: Theta = None,
    points: Points = 101,
    noise: Noise = None,
    seed: Seed = None,
    bending: Bending = None,
    out: Out = None,
    cache: Cache = True,
) -> None:
    """Predict the maps of the drive's harmonics for one mode, as a file and a figure."""
    if not 0 < z <= LARGEST_Z:
        raise ParameterError(
            f"--z {z:g}: expected a positive modulation up to {LARGEST_Z}, such as 4.218"
        )
    if theta is not None and fringe == "multilayer":
        raise ParameterError(
            f"--theta {theta:g}: the gap of the stack is the working point; use --fringe sine"
        )
    if seed is not None and noise is None:
        raise ParameterError(f"--seed {seed}: there is no noise to draw; give it with --noise")
    theta = math.pi / 4 if theta is None else theta
    seed = 1 if seed is None else seed
    if not -math.pi <= theta <= math.pi:
        raise ParameterError(
            f"--theta {theta:g}: expected an angle in rad from −π to π, such as 0.785"
        )
    if fringe not in FRINGES:
        raise ParameterError(f"--fringe {fringe}: expected {' or '.join(FRINGES)}")
    index = check_mode(mode)
    need_memory(
        OWN + HELD * points**2 * harmonics,
        f"maps of {points} × {points} points and {harmonics} harmonics",
        "lower --points or --harmonics",
    )
    if out is not None:
        suffix_of(out, (".nc",))  # the figure takes the same name with another ending
        need_room(out)
    # Both are read before devices, modes and figures load
    noise_sd = None if noise is None else _voltage(noise)
    length = _length(wavelength)
    model = load_device(geometry, bending)
    readout = _fringe(model, fringe, length, theta)
    path = out or Path(f"{model.name}-mode-{mode}-maps.nc")
    need_room(path)
    from femnl.device.geometry.curves import polyline
    from femnl.io import measurement
    from femnl.pipeline import harmonic_maps, solve_modes
    from femnl.plot.maps import harmonic_map_figure

    amplitude = z * length / (4 * math.pi)
    modes = solve_modes(model, max(10, mode), cache=cache)
    name = f"mode {modes.label[index] or mode}"
    title = (
        f"{model.name}, {name}, z = {z:g} at {length * 1e9:g} nm, U = {amplitude * 1e9:.4g} "
        f"nm, {fringe} fringe"
    )
    result = harmonic_maps(
        modes, index, readout, amplitude, length, harmonics=harmonics, points=points
    )
    values = result.values
    if noise_sd is not None:
        values = values + _noise(values.shape, noise_sd, seed)
        note(f"added noise of {noise_sd:.4g} V in each quadrature, seed {seed}")
    dataset = measurement.harmonic_map(
        result.x, result.y, result.harmonic, values, noise_sd=noise_sd, wavelength=length
    )
    attributes = {
        "title": title,
        "source": f"simulated by femnl {femnl.__version__}",
        "model": model.described,
    }
    measurement.write(measurement.bundle({"map": dataset}, geometry=model.name, **attributes), path)
    picture = path.with_suffix(".png")
    write_whole(
        picture,
        partial(harmonic_map_figure(dataset, polyline(model.outline), title).savefig, dpi=200),
    )
    note(f"wrote {path} and {picture}")


def _length(wavelength: str) -> float:
    """Return the wavelength [m] of light that words mean."""
    length, _ = quantity(wavelength, "m", f'--wavelength "{wavelength}"')
    if not 1e-7 < length < 1e-4:
        raise ParameterError(
            f'--wavelength "{wavelength}": {length:g} m is no wavelength of light; write e.g. '
            '"632.8 nm"'
        )
    return length


def _voltage(noise: str) -> float:
    """Return the standard deviation [V] that words mean."""
    noise_sd, _ = quantity(noise, "V", f'--noise "{noise}"')
    if not 0 < noise_sd < math.inf:
        raise ParameterError(f'--noise "{noise}": expected a positive voltage; write "0.3 mV"')
    return noise_sd


def _noise(shape: tuple[int, ...], sd: float, seed: int) -> NDArray[np.complex128]:
    """Draw normal noise [V], of the same standard deviation in both quadratures."""
    from numpy.random import default_rng

    rng = default_rng(seed)
    return rng.normal(0, sd, shape) + 1j * rng.normal(0, sd, shape)


def _fringe(model: Model, kind: str, wavelength: float, theta: float) -> Fringe:
    """Return the fringe that was asked for, with unit contrast.

    1 V for the sine, 1 V per unit of reflectivity for the stack.
    """
    if kind == "sine":
        from femnl.optics.fringe import SineFringe

        return SineFringe(wavelength, 0.0, 1.0, theta)
    if model.stack is None:
        raise ParameterError(
            f"{model.name}: its geometry gives no [readout] gap, which the multilayer fringe "
            "needs; use --fringe sine"
        )
    from femnl.optics.fringe import MultilayerFringe

    return MultilayerFringe(model.stack, wavelength)
