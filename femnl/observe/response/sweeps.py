"""Driven sweeps as flat arrays, ready to be fitted."""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from femnl.core.arrays import freeze
from femnl.core.errors import MeasurementError
from femnl.io.measurement import noise_sd

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Index = NDArray[np.intp]

FEWEST_POINTS = 8
"""Usable points that a sweep needs."""


@dataclass(frozen=True)
class Sweeps:
    """All usable points of all sweeps, sweep after sweep, each by rising frequency.

    frequency (n,) [Hz]; voltage (n,) complex [V]; drive (n,) relative to `reference` [V]; sweep and
    position (n,): which one a point belongs to; row and column (n,): its place in the dataset;
    spans: where each sweep lies; direction of each sweep, +1 up, −1 down, 0 unknown; positions
    (n_positions, 2): x, y [m]; noise [V] per quadrature; notes for the report; phases: whether the
    file has phases, or magnitudes alone, which stand as real voltages; estimated: whether the noise
    is that of the data's own scatter.
    """

    frequency: Array
    voltage: Complex
    drive: Array
    sweep: Index
    position: Index
    row: Index
    column: Index
    spans: tuple[slice, ...]
    direction: tuple[int, ...]
    positions: Array
    reference: float
    noise: float
    notes: tuple[str, ...]
    phases: bool = True
    estimated: bool = False

    def __post_init__(self) -> None:
        freeze(self)

    def keep(self, mask: NDArray[np.bool_], note: str) -> "Sweeps":
        """Return the points where mask (n,) is True, with a note on the rest.

        Sweeps may become empty.
        """
        if mask.all():
            return self
        if not np.array_equal(np.unique(self.position[mask]), np.arange(self.n_positions)):
            raise MeasurementError(
                f"{note}: no point is left at some position; leave that position out"
            )
        ends = np.concatenate([[0], np.cumsum(mask)])
        spans = tuple(slice(int(ends[s.start]), int(ends[s.stop])) for s in self.spans)
        points = {
            name: getattr(self, name)[mask]
            for name in ("frequency", "voltage", "drive", "sweep", "position", "row", "column")
        }
        return replace(
            self, **points, spans=spans, notes=(*self.notes, f"{np.count_nonzero(~mask)} {note}")
        )

    @property
    def n_positions(self) -> int:
        """How many positions of the readout there are."""
        return len(self.positions)

    @property
    def span(self) -> float:
        """The range of frequencies covered, in Hz."""
        return float(np.ptp(self.frequency))


def repeated(sweeps: Sweeps, count: int) -> Sweeps:
    """Return the same sweeps several times, one after the other."""
    n = len(sweeps.frequency)
    number = np.repeat(np.arange(count), n)
    begins = (n * np.arange(count)).tolist()
    return replace(
        sweeps,
        frequency=np.tile(sweeps.frequency, count),
        voltage=np.tile(sweeps.voltage, count),
        drive=np.tile(sweeps.drive, count),
        sweep=np.tile(sweeps.sweep, count) + len(sweeps.spans) * number,
        position=np.tile(sweeps.position, count),
        row=np.tile(sweeps.row, count),
        column=np.tile(sweeps.column, count),
        spans=tuple(slice(s.start + at, s.stop + at) for at in begins for s in sweeps.spans),
        direction=count * sweeps.direction,
    )


def collect(dataset: xr.Dataset) -> Sweeps:
    """Flatten the sweeps of the first harmonic of a `response` dataset.

    Missing points are left out, and the noise is as stored or estimated.

    Raises:
        MeasurementError: wrong kind, no first harmonic, a drive that is not positive, or fewer than
        8 points in a sweep.
    """
    if dataset.attrs.get("kind") != "response":
        raise MeasurementError(
            f"kind = {dataset.attrs.get('kind')!r}: a Duffing response is fitted to a measurement "
            "of kind 'response'"
        )
    noise, sentence = noise_sd(dataset)
    kept, note = first_harmonics(dataset)
    notes = [sentence, *note]
    if "drive" not in dataset and dataset.sizes["sweep"] > 1:
        notes.append("drive is not in the file: all sweeps are taken to have the same")
    drive = _per_sweep(dataset, "drive", 1.0)
    if not np.all(drive[kept] > 0):
        raise MeasurementError(
            f"drive = {drive.min():g} V: drives must be positive; put a change of sign into "
            "the phase"
        )
    place = np.stack([_per_sweep(dataset, "x", 0.0), _per_sweep(dataset, "y", 0.0)], axis=1)
    positions, position = np.unique(place[kept], axis=0, return_inverse=True)
    frequency = dataset["frequency"].values
    phases = "magnitude" not in dataset
    if phases:
        voltage = dataset["real"].values + 1j * dataset["imag"].values
    else:
        voltage = dataset["magnitude"].values + 0j
    orders = [_rising(int(s), frequency[s], voltage[s]) for s in kept]
    lengths = [len(order) for order in orders]
    missing = len(kept) * voltage.shape[1] - sum(lengths)
    if missing:
        notes.append(f"{missing} missing points left out")
    row = np.repeat(kept, lengths)
    column = np.concatenate(orders)
    reference = float(drive[kept].max())
    direction = _per_sweep(dataset, "direction", np.nan)
    return Sweeps(
        frequency[row, column],
        voltage[row, column],
        np.repeat(drive[kept] / reference, lengths),
        np.repeat(np.arange(len(kept)), lengths),
        np.repeat(position.ravel(), lengths),
        row,
        column,
        _spans(lengths),
        tuple(int(d) if abs(d) == 1 else 0 for d in direction[kept]),
        positions,
        reference,
        noise,
        tuple(notes),
        phases,
        "noise_sd" not in dataset.attrs,
    )


def first_harmonics(dataset: xr.Dataset) -> tuple[Index, list[str]]:
    """Return which sweeps are of the first harmonic, and a note where others are left out.

    Raises: MeasurementError where there is none.
    """
    harmonic = _per_sweep(dataset, "harmonic", 1.0)
    kept = np.flatnonzero(harmonic == 1)
    if not len(kept):
        raise MeasurementError(
            f"harmonic = {sorted(set(harmonic))}: none is the first, whose response the Duffing "
            "model describes"
        )
    others = len(harmonic) - len(kept)
    return kept, [f"{others} sweeps of higher harmonics left out"] if others else []


def _rising(sweep: int, frequency: Array, voltage: Complex) -> Index:
    """Return the points of a sweep that were measured, by rising frequency.

    Raises: MeasurementError for fewer than `FEWEST_POINTS`, and where there is no response.
    """
    good = np.flatnonzero(np.isfinite(voltage) & np.isfinite(frequency))
    if len(good) < FEWEST_POINTS:
        raise MeasurementError(
            f"sweep {sweep}: {len(good)} usable points; a fit needs at least {FEWEST_POINTS}, "
            "leave the sweep out"
        )
    if np.any(frequency[good] <= 0):
        raise MeasurementError(
            f"sweep {sweep}: a frequency of {frequency[good].min():g} Hz is not positive; of "
            "detunings, add the frequency that they count from"
        )
    if not np.any(voltage[good] != voltage[good[0]]) or not np.ptp(frequency[good]):
        raise MeasurementError(
            f"sweep {sweep}: one value at all its {len(good)} points, so no response to fit; "
            "leave the sweep out"
        )
    return good[np.argsort(frequency[good], kind="stable")]


def _spans(lengths: list[int]) -> tuple[slice, ...]:
    """Return where each sweep lies when they follow one after the other."""
    ends = np.cumsum([0, *lengths]).tolist()
    return tuple(slice(start, stop) for start, stop in pairwise(ends))


def _per_sweep(dataset: xr.Dataset, name: str, default: float) -> Array:
    return np.asarray(
        dataset[name].values if name in dataset else np.full(dataset.sizes["sweep"], default),
        dtype=float,
    )
