"""`femnl fit FILE`: parameters with their uncertainties, from every measurement of a file."""

from pathlib import Path
from typing import Annotated, Any, get_args

import numpy as np
import typer
import xarray as xr

from femnl import measurement
from femnl.cli._device import Cache, Json, check_mode
from femnl.cli._output import console, note, print_json, scientific, table
from femnl.errors import MeasurementError, ParameterError
from femnl.fits.mapmodel import Shape
from femnl.fits.maps import fit_map
from femnl.fits.response import fit_response
from femnl.fits.response_misfit import Use
from femnl.fits.spot import fit_spot
from femnl.fits.traces import decompose
from femnl.modes import shape_at
from femnl.optics import MultilayerFringe
from femnl.predict import measured_device, solve_modes
from femnl.types.device import Model
from femnl.types.fit import Fit, MotionFit
from femnl.types.readout import PeriodicFringe

OVERTONES = 5  # of a fringe whose form is fitted too; enough for the reflection of a film above a wafer
USES: tuple[Use, ...] = get_args(Use)
File = Annotated[Path, typer.Argument(help="A measurement file (.nc).", show_default=False)]
UseOption = Annotated[str, typer.Option(help=f"Of a response: {', '.join(USES)}.")]
Damping = Annotated[bool, typer.Option("--nonlinear-damping", help="Of a response: fit a damping that grows with the amplitude too.")]
Fringe = Annotated[str, typer.Option(help="Of maps and traces: sine; multilayer, the geometry's stack; free, a fringe of any form (maps).")]
Device = Annotated[str | None, typer.Option("--geometry", help="Device, where not the one the file names.", show_default=False)]
Harmonics = Annotated[int, typer.Option(help="Of a trace: highest harmonic.", min=1, max=200)]


def command(
    file: File,
    use: UseOption = "complex",
    nonlinear_damping: Damping = False,
    fringe: Fringe = "sine",
    mode: Annotated[int, typer.Option(help="Of a map: which mode moves, from 1.")] = 1,
    geometry: Device = None,
    harmonics: Harmonics = 21,
    cache: Cache = True,
    as_json: Json = False,
) -> None:
    """Fit what was measured: responses, harmonic maps (all of a file with one amplitude), traces."""
    tree = measurement.read(file)
    for repair in tree.attrs["repairs"]:
        note(f"repaired: {repair}")
    groups = {name: node.to_dataset() for name, node in tree.children.items()}
    results: dict[str, Any] = {}
    for name, dataset in groups.items():
        if dataset.attrs["kind"] == "response":
            results[name] = fit_response(dataset, _use(use), nonlinear_damping=nonlinear_damping)
        elif dataset.attrs["kind"] == "trace":
            results[name] = decompose(dataset, harmonics)
            if "wavelength" in dataset.attrs:
                device = measured_device(tree.attrs, file, geometry)
                motion = fit_spot(results[name], float(dataset.attrs["wavelength"]), _fringe(fringe, device, dataset))
                results[f"{name}, motion"] = motion
    maps = {name: dataset for name, dataset in groups.items() if dataset.attrs["kind"] == "map"}
    if maps:
        device = measured_device(tree.attrs, file, geometry)
        fringes = {name: _fringe(fringe, device, dataset) for name, dataset in maps.items()}
        known = {name: found for name, found in fringes.items() if found is not None}
        one, overtones = len(maps) == 1, OVERTONES if fringe == "free" else 1
        data = next(iter(maps.values())) if one else maps
        chosen = (next(iter(known.values())) if one else known) if known else None
        results[" and ".join(maps)] = fit_map(data, _shape(device, check_mode(mode), cache), chosen, free_overtones=overtones).fit
    if not results:
        kinds = ", ".join(sorted({str(dataset.attrs["kind"]) for dataset in groups.values()}))
        raise MeasurementError(f"{file}: holds {kinds}, which femnl does not fit; it fits response, map and trace")
    if as_json:
        print_json({"file": str(file), "fits": {name: _record(result) for name, result in results.items()}})
    else:
        for name, result in results.items():
            _show(name, result)


def _use(text: str) -> Use:
    for known in USES:
        if text == known:
            return known
    raise ParameterError(f"--use {text}: expected one of {', '.join(USES)}")


def _shape(device: Model, index: int, cache: bool) -> Shape:
    modes = solve_modes(device, max(10, index + 1), cache=cache)
    return lambda x, y: shape_at(modes, index, x, y)


def _fringe(kind: str, device: Model, dataset: xr.Dataset) -> PeriodicFringe | None:
    if kind in ("sine", "free"):
        return None
    if kind != "multilayer":
        raise ParameterError(f"--fringe {kind}: expected sine, multilayer or free")
    if device.stack is None:
        raise ParameterError(f"{device.name}: its geometry gives no [readout] gap, which the multilayer fringe needs; use --fringe sine")
    return MultilayerFringe(device.stack, float(dataset.attrs["wavelength"]))


def _record(result: Any) -> dict[str, Any]:
    if isinstance(result, MotionFit):
        motion = {"amplitude": result.amplitude, "amplitude_sd": result.amplitude_sd, "phase": result.phase, "phase_sd": result.phase_sd}
        return _record(result.fit) | motion
    if not isinstance(result, Fit):
        values = {"real": result.values.real, "imag": result.values.imag, "sd": result.values_sd}
        return {"drive_frequency": result.drive_frequency, "harmonic": result.harmonic, **values, "noise_sd": result.noise_sd}
    parameters = {p.name: {"value": p.value, "sd": p.sd, "unit": p.unit} for p in result.parameters.values()}
    return {"parameters": parameters, "chi2_reduced": result.chi2_reduced, "n_points": result.n_points, "notes": result.notes}


def _show(name: str, result: Any) -> None:
    if isinstance(result, MotionFit):
        _show(name, result.fit)
        strongest = int(np.argmax(result.amplitude))
        value, sd = _with_error(result.amplitude[strongest] * 1e9, result.amplitude_sd[strongest] * 1e9)
        console().print(f"  largest amplitude {value} ± {sd} nm, at step {strongest + 1} of {len(result.amplitude)}")
        return
    if not isinstance(result, Fit):
        strongest = int(np.argmax(np.abs(result.values[1:]).max(axis=0)))
        rows = [
            [f"{n}", f"{abs(value) * 1e3:.4g}", f"{np.degrees(np.angle(value)):.1f}", f"{sd * 1e3:.2g}"]
            for n, value, sd in zip(result.harmonic, result.values[:, strongest], result.values_sd[:, strongest], strict=True)
        ]
        title = f"{name}: harmonics at the strongest step, drive {result.drive_frequency[strongest]:.9g} Hz"
        console().print(table(title, ["harmonic", "|V| (mV)", "phase (°)", "± (mV)"], rows))
        return
    rows = [[p.name, *_with_error(p.value, p.sd), p.unit or "–"] for p in result.parameters.values()]
    title = f"{name}: {result.n_points} numbers, {result.n_parameters} free parameters, χ²/ν = {result.chi2_reduced:.4g}"
    console().print(table(title, ["parameter", "value", "±", "unit"], rows))
    for sentence in result.notes:
        console().print(f"  {sentence}")


def _with_error(value: float, sd: float) -> tuple[str, str]:
    """A value to the digits that its standard deviation, given to two digits, leaves."""
    if not np.isfinite(sd) or sd <= 0 or value == 0:
        return scientific(value, 6), "unknown" if not np.isfinite(sd) else "0"
    digits = max(1, int(np.floor(np.log10(abs(value)))) - int(np.floor(np.log10(sd))) + 2)
    return scientific(value, digits), scientific(sd, 2)
