"""`femnl fit FILE`: parameters with their uncertainties, from every measurement of a file."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args

import typer

from femnl.cli._device import Cache, Json, check_mode, known_geometry
from femnl.cli._fit_checks import check_options, one_of, refuse_beside_modes, samples
from femnl.cli._fit_decay import FEW, summary
from femnl.cli._fit_kinds import MEANINGS, FitOptions, MeasuredFile, fit_file, measured_file
from femnl.cli._fit_response import Asked
from femnl.cli._fixed import read as read_fixed
from femnl.cli._inputs import Inputs, files_of, read_file
from femnl.cli._outcome import Outcome
from femnl.cli._output import console, note, print_json
from femnl.core.choices import Background, Law, Use
from femnl.core.errors import ConvergenceError, MeasurementError, ParameterError, numbers_of

if TYPE_CHECKING:
    import xarray as xr

USES: tuple[Use, ...] = get_args(Use)
LAWS: tuple[Law, ...] = get_args(Law)
FRINGES = ("sine", "multilayer", "free")
BACKGROUNDS: tuple[Background | Literal["auto"], ...] = ("auto", *get_args(Background))

As = Annotated[
    str | None,
    typer.Option(
        "--as",
        help="Of a response: overview (find the lines of a wide sweep, name their modes), "
        "line-scan (every "
        "place on "
        "its own). "
        "Of a trace: ring-down, envelope (of one), oscillator (with its drive). "
        "decay: only decays.",
        show_default=False,
    ),
]
UseOption = Annotated[
    str | None,
    typer.Option(
        help=f"Of a response: {', '.join(USES)}; by default what it has.", show_default=False
    ),
]
BackgroundOption = Annotated[
    str,
    typer.Option(
        "--background", help=f"Of a response: {', '.join(BACKGROUNDS)}, auto by evidence."
    ),
]
Linear = Annotated[bool, typer.Option("--linear", help="Of a response: no Duffing term.")]
Fix = Annotated[
    list[str] | None,
    typer.Option(
        "--fix",
        help='A parameter that is held: NAME=VALUE in SI or with its unit ("amplitude=120 nm"); '
        "repeatable.",
        show_default=False,
    ),
]
EachSweep = Annotated[
    Path | None,
    typer.Option(
        "--each-sweep",
        help="Of a response: fit each sweep on its own, and write the series to this .nc file.",
        show_default=False,
    ),
]
Modes = Annotated[
    int | None,
    typer.Option(
        "--modes",
        help="Of a response: so many linear modes in the span.",
        min=1,
        max=40,
        show_default=False,
    ),
]
LawOption = Annotated[str, typer.Option("--law", help=f"Of a series: {', '.join(LAWS)}.")]
Against = Annotated[
    str | None,
    typer.Option(
        help="Of a series: the control variable of the law, where several vary.",
        show_default=False,
    ),
]
Damping = Annotated[
    bool,
    typer.Option(
        "--nonlinear-damping",
        help="Of a response: fit a damping that grows with the amplitude too.",
    ),
]
Fringe = Annotated[
    str,
    typer.Option(
        help="Of maps and traces: sine; multilayer, the geometry's stack; free, a fringe of any "
        "form (maps)."
    ),
]
HeldOut = Annotated[
    str | None,
    typer.Option(
        help="Of an oscillator: samples FIRST:END to test on, not to fit.", show_default=False
    ),
]
Device = Annotated[
    str | None,
    typer.Option(
        "--geometry",
        help="Device, where not the one the file names.",
        show_default=False,
        callback=known_geometry,
    ),
]
Harmonics = Annotated[
    int | None,
    typer.Option(
        "--harmonics",
        help="Of a trace: highest harmonic; unless given, all that it can tell apart, up to 21.",
        min=1,
        max=200,
    ),
]
Out = Annotated[
    Path | None,
    typer.Option(
        help="Folder for figures, and for the spectrum of an overview.", show_default=False
    ),
]


def command(
    context: typer.Context,
    files: Inputs,
    *,
    meaning: As = None,
    use: UseOption = None,
    background: BackgroundOption = "auto",
    linear: Linear = False,
    fix: Fix = None,
    nonlinear_damping: Damping = False,
    each_sweep_to: EachSweep = None,
    n_modes: Modes = None,
    law_name: LawOption = "line",
    against: Against = None,
    fringe: Fringe = "sine",
    mode: Annotated[int, typer.Option(help="Of a map: which mode moves, from 1.")] = 1,
    geometry: Device = None,
    n_harmonics: Harmonics = None,
    held_out: HeldOut = None,
    out: Out = None,
    cache: Cache = True,
    as_json: Json = False,
) -> None:
    """Fit what was measured: spectra, responses, ring-downs, traces and harmonic maps.

    All maps of a file are fitted with one amplitude.
    """
    how = None if use is None else one_of("--use", use, USES)
    fixed = read_fixed(fix or [])
    asked = Asked(
        how,
        one_of("--background", background, BACKGROUNDS),
        linear,
        nonlinear_damping,
        fixed,
    )
    options = FitOptions(
        meaning=None if meaning is None else one_of("--as", meaning, tuple(MEANINGS)),
        response=asked,
        fixed=fixed,
        n_modes=n_modes,
        each_sweep=each_sweep_to is not None,
        law=one_of("--law", law_name, LAWS),
        against=against,
        fringe=one_of("--fringe", fringe, FRINGES),
        mode=check_mode(mode),
        geometry=geometry,
        n_harmonics=n_harmonics,
        held_out=samples(held_out),
        cache=cache,
    )
    if each_sweep_to is not None and n_modes is not None:
        raise ParameterError(
            "--each-sweep fits one mode a sweep, and --modes several; leave one of them out"
        )
    if n_modes is not None:
        refuse_beside_modes(context)
    listed = files_of(files)
    if each_sweep_to is not None and len(listed) > 1:
        raise ParameterError(
            f"--each-sweep: {len(listed)} files for one series; give one file at a time"
        )

    def fit_one(path: Path, tree: xr.DataTree) -> dict[str, Outcome]:
        file = measured_file(path, tree, options)
        check_options(context, file.meanings)
        results = fit_file(file, alone=len(listed) == 1)
        if each_sweep_to is not None:
            _write_series(results, each_sweep_to)
        if out is not None:
            _write(results, out, path.stem, _origin(file))
        return results

    records = _fit_files(listed, fit_one, shows=not as_json)
    if as_json:
        print_json(records[0] if len(listed) == 1 else {"files": records})
    elif _has_decays(records) and (len(listed) > 1 or len(records[0]["fits"]) > FEW):
        console().print(summary(records))


def _fit_files(
    files: Sequence[Path],
    fit_one: Callable[[Path, xr.DataTree], dict[str, Outcome]],
    *,
    shows: bool,
) -> list[dict[str, Any]]:
    """Fit file after file. One that cannot be used beside others is named and left out."""
    records: list[dict[str, Any]] = []
    for file in files:
        try:
            tree = read_file(file, "fit")
            for repair in tree.attrs["repairs"]:
                note(f"repaired: {repair}")
            with numbers_of(str(file)):
                results = fit_one(file, tree)
        except (MeasurementError, ParameterError, ConvergenceError) as error:
            if len(files) == 1:
                raise
            text = str(error)
            note(text if str(file) in text else f"{file}: {text}")
            continue
        fits = {name: result.record for name, result in results.items()}
        records.append({"file": str(file), "fits": fits})
        for line in (line for result in results.values() for line in result.shown if shows):
            console().print(line)
    if not records:
        raise MeasurementError(f"none of the {len(files)} files can be fitted")
    return records


def _has_decays(records: Sequence[Mapping[str, Any]]) -> bool:
    return any("phases" in fit for found in records for fit in found["fits"].values())


def _write_series(results: dict[str, Outcome], path: Path) -> None:
    """Write the series that single sweeps make, one group a measurement."""
    from femnl.io import measurement

    found = {
        name: result.spectra["series"]
        for name, result in results.items()
        if "series" in result.spectra
    }
    measurement.write(measurement.bundle(found), path)
    note(f"wrote {path}")


def _origin(file: MeasuredFile) -> dict[str, str]:
    """Return attributes that files made from a measurement keep: its title, source and device."""
    kept = {
        key: str(file.attributes[key])
        for key in ("title", "source", "sample")
        if key in file.attributes
    }
    if file.has_device:
        device = file.device()
        kept |= {"geometry": device.name, "model": device.described}
    return kept


def _write(
    results: dict[str, Outcome], folder: Path, stem: str, attributes: dict[str, str]
) -> None:
    """Draw the figures and write the spectra that fits found, named after file and measurement."""
    from femnl.io import measurement
    from femnl.io.results.atomic import write_whole

    folder.mkdir(parents=True, exist_ok=True)
    for name, result in results.items():
        start = f"{stem}-{name}".replace(", ", "-").replace(" ", "-")
        for kind, draw in result.figures.items():
            picture = folder / f"{start}-{kind}.png"
            write_whole(picture, partial(draw().savefig, dpi=200))
            note(f"wrote {picture}")
        for kind, dataset in result.spectra.items():
            path = folder / f"{start}-{kind}.nc"
            measurement.write(measurement.bundle({kind: dataset}, **attributes), path)
            note(f"wrote {path}")
