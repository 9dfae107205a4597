"""Driven sweeps as flat arrays, ready to be fitted."""

from dataclasses import dataclass, replace

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from femnl.core.arrays import freeze
from femnl.core.errors import MeasurementError
from femnl.io.measurement import noise_sd

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Index = NDArray[np.intp]


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


def collect(dataset: xr.Dataset) -> Sweeps:
    """Flatten a `response` dataset.

    First harmonic only, missing points left out, noise as stored or estimated.

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
    notes = [sentence]
    count = dataset.sizes["sweep"]
    harmonic = _per_sweep(dataset, "harmonic", 1.0)
    if not np.any(harmonic == 1):
        raise MeasurementError(
            f"harmonic = {sorted(set(harmonic))}: none is the first, whose response the Duffing "
            "model describes"
        )
    if np.any(harmonic != 1):
        notes.append(f"{np.count_nonzero(harmonic != 1)} sweeps of higher harmonics left out")
    if "drive" not in dataset and count > 1:
        notes.append("drive is not in the file: all sweeps are taken to have the same")
    drive = _per_sweep(dataset, "drive", 1.0)
    direction = _per_sweep(dataset, "direction", np.nan)
    if not np.all(drive[harmonic == 1] > 0):
        raise MeasurementError(
            f"drive = {drive.min():g} V: drives must be positive; put a change of sign into "
            "the phase"
        )
    place = np.stack([_per_sweep(dataset, "x", 0.0), _per_sweep(dataset, "y", 0.0)], axis=1)
    kept = np.flatnonzero(harmonic == 1)
    positions, position = np.unique(place[kept], axis=0, return_inverse=True)
    frequency = dataset["frequency"].values
    phases = "magnitude" not in dataset
    if phases:
        voltage = dataset["real"].values + 1j * dataset["imag"].values
    else:
        voltage = dataset["magnitude"].values + 0j
    pieces = []
    start = 0
    missing = 0
    spans: list[slice] = []
    for s in kept:
        good = np.flatnonzero(np.isfinite(voltage[s]) & np.isfinite(frequency[s]))
        missing += voltage.shape[1] - len(good)
        if len(good) < 8:
            raise MeasurementError(
                f"sweep {s}: {len(good)} usable points; a fit needs at least 8, leave the sweep out"
            )
        if not np.any(voltage[s, good] != voltage[s, good[0]]) or not np.ptp(frequency[s, good]):
            raise MeasurementError(
                f"sweep {s}: one value at all its {len(good)} points, so no response to fit; "
                "leave the sweep out"
            )
        order = good[np.argsort(frequency[s, good], kind="stable")]
        pieces.append((frequency[s, order], voltage[s, order], np.full(len(order), s), order))
        spans.append(slice(start, start + len(good)))
        start += len(good)
    if missing:
        notes.append(f"{missing} missing points left out")
    lengths = [len(piece[0]) for piece in pieces]
    points = [np.concatenate(part) for part in zip(*pieces, strict=True)]
    reference = float(drive[kept].max())
    return Sweeps(
        points[0],
        points[1],
        np.repeat(drive[kept] / reference, lengths),
        np.repeat(np.arange(len(kept)), lengths),
        np.repeat(position.ravel(), lengths),
        points[2],
        points[3],
        tuple(spans),
        tuple(int(d) if abs(d) == 1 else 0 for d in direction[kept]),
        positions,
        reference,
        noise,
        tuple(notes),
        phases,
        "noise_sd" not in dataset.attrs,
    )


def _per_sweep(dataset: xr.Dataset, name: str, default: float) -> Array:
    return np.asarray(
        dataset[name].values if name in dataset else np.full(dataset.sizes["sweep"], default),
        dtype=float,
    )
