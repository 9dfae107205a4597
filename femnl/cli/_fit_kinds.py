"""What `femnl fit` does with one file: which measurements it fits, and each of them how."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from femnl.cli._fit_decay import FEW, decays
from femnl.cli._fit_map import maps, readout
from femnl.cli._fit_response import Asked, each_sweep, line_scan, modes, response
from femnl.cli._fit_series import law
from femnl.cli._fit_spectrum import film, overview
from femnl.cli._fit_trace import harmonics, oscillator, ringdown
from femnl.cli._fixed import Texts
from femnl.cli._outcome import Outcome
from femnl.core.choices import Law
from femnl.core.errors import MeasurementError, ParameterError

if TYPE_CHECKING:
    import xarray as xr

    from femnl.core.device import Model
    from femnl.core.readout import PeriodicFringe

FITTED = ("response", "spectrum", "trace", "map", "decay", "series")
# What a measurement may be taken for where its kind alone does not say, and the kind that it must
# then have.
MEANINGS = {
    "overview": "response",
    "line-scan": "response",
    "ring-down": "trace",
    "envelope": "trace",
    "oscillator": "trace",
    "decay": "decay",
}


@dataclass(frozen=True)
class FitOptions:
    """What the command line asks of every file.

    meaning: a key of MEANINGS, None to go by the kind of each measurement; response: the options of
    responses; fixed: values that are held, as written; n_modes: linear modes to fit to a response,
    None for one Duffing mode; each_sweep: whether each sweep of a response is fitted on its own;
    law: of a series; against: its control variable, None for the only one that varies; fringe: of
    maps and traces; mode: index of the mode of a map; geometry: the device, None for that of the
    file; n_harmonics: highest harmonic of a trace; held_out: samples of an oscillator to test on;
    cache: whether modes are kept on disk.
    """

    meaning: str | None
    response: Asked
    fixed: Texts
    n_modes: int | None
    each_sweep: bool
    law: Law
    against: str | None
    fringe: str
    mode: int
    geometry: str | None
    n_harmonics: int | None
    held_out: slice | None
    cache: bool


@dataclass(frozen=True, eq=False)
class MeasuredFile:
    """The measurements of one file that are fitted, by name, and what is asked of them."""

    path: Path
    attributes: Mapping[Any, Any]
    groups: Mapping[str, xr.Dataset]
    options: FitOptions

    @property
    def meanings(self) -> set[str]:
        """What the measurements are taken for: what --as says, or their kinds."""
        return {self.meaning_of(dataset) for dataset in self.groups.values()}

    @property
    def has_device(self) -> bool:
        """Whether the command line or the file names a device."""
        named = not {"model", "geometry"}.isdisjoint(self.attributes)
        return self.options.geometry is not None or named

    def meaning_of(self, dataset: xr.Dataset) -> str:
        """Return what a measurement is taken for."""
        return self.options.meaning or str(dataset.attrs["kind"])

    def of_kind(self, kind: str) -> dict[str, xr.Dataset]:
        """Return the measurements of one kind."""
        return {name: data for name, data in self.groups.items() if data.attrs["kind"] == kind}

    def device(self) -> Model:
        """Return the device. Raises: an error that says how to name one where none is named."""
        from femnl.pipeline import measured_device

        return measured_device(self.attributes, self.path, self.options.geometry)


def measured_file(path: Path, tree: xr.DataTree, options: FitOptions) -> MeasuredFile:
    """Choose the measurements: all that femnl fits, or with --as those of its kind.

    Raises: ParameterError for an --as that nothing in the file fits; MeasurementError where the
    file holds nothing that can be fitted.
    """
    meaning = options.meaning
    groups = {name: node.to_dataset() for name, node in tree.children.items()}
    kinds = (MEANINGS[meaning],) if meaning else FITTED
    chosen = {name: dataset for name, dataset in groups.items() if dataset.attrs["kind"] in kinds}
    if not chosen:
        there = ", ".join(sorted({str(dataset.attrs["kind"]) for dataset in groups.values()}))
        if meaning:
            raise ParameterError(
                f"--as {meaning}: takes a {MEANINGS[meaning]}, but {path} holds {there}"
            )
        raise MeasurementError(f"{path}: holds {there}; femnl fit takes {', '.join(FITTED)}")
    return MeasuredFile(path, tree.attrs, chosen, options)


def fit_file(file: MeasuredFile, *, alone: bool) -> dict[str, Outcome]:
    """Fit all measurements of a file: one by one, then its decays, then its maps together.

    Args: alone: whether no other file is fitted, so that a few decays are shown in full.
    """
    results: dict[str, Outcome] = {}
    for name, dataset in file.groups.items():
        results |= _fit_measurement(name, dataset, file)
    of_decay = file.of_kind("decay")
    if of_decay:
        whole = alone and len(of_decay) <= FEW
        results |= decays(of_decay, file.options.fixed, whole=whole)
    of_map = file.of_kind("map")
    if of_map:
        options = file.options
        results |= maps(of_map, file.device(), options)
    return results


def _fit_measurement(name: str, dataset: xr.Dataset, file: MeasuredFile) -> Mapping[str, Outcome]:
    """Fit one measurement; nothing for decays and maps, which are fitted together."""
    options = file.options
    match file.meaning_of(dataset):
        case "overview":
            device = file.device() if file.has_device else None
            return overview(name, dataset, device, options.cache)
        case "line-scan":
            return line_scan(name, dataset, options.response)
        case "ring-down":
            return ringdown(name, dataset, options.fixed, envelope=False)
        case "envelope":
            return ringdown(name, dataset, options.fixed, envelope=True)
        case "oscillator":
            return oscillator(name, dataset, options.held_out, options.fixed)
        case "response":
            return _fit_response(name, dataset, options)
        case "series":
            return law(name, dataset, options.law, options.against, options.fixed)
        case "spectrum":
            return film(name, dataset, file.device(), options.cache, options.fixed)
        case "trace":
            fringe = _fringe_of(dataset, file)
            return harmonics(name, dataset, options.n_harmonics, fringe, options.fixed)
    return {}


def _fit_response(name: str, dataset: xr.Dataset, options: FitOptions) -> Mapping[str, Outcome]:
    """Fit a response as several linear modes, sweep by sweep, or all sweeps together."""
    if options.n_modes:
        return modes(name, dataset, options.n_modes, options.fixed)
    if options.each_sweep:
        return each_sweep(name, dataset, options.response)
    return response(name, dataset, options.response)


def _fringe_of(dataset: xr.Dataset, file: MeasuredFile) -> PeriodicFringe | None:
    """Return the fringe of a trace that its device makes.

    None stands for a sine, and where no wavelength turns it into metres.
    """
    if "wavelength" not in dataset.attrs or file.options.fringe == "sine":
        return None
    return readout(file.options.fringe, file.device(), dataset, ("sine", "multilayer"))
