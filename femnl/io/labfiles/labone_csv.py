"""Sweeps saved by Zurich Instruments LabOne as text.

The sweeper writes one line for each field of each sweep, separated by semicolons (or commas, as set
in LabOne):

    chunk;timestamp;size;fieldname;value;value;…

`chunk` counts the sweeps, `size` says how many values follow, shorter lines are filled up with nan.
Fields used: `frequency` (else `grid`, the swept values), `x` and `y` (else `r` and `phase` in rad).
Points come in the order taken, so a falling grid is a sweep down. A file with one line a sample
(chunk;timestamp;x;y;freq;…) is a table of samples and is read as such. Demodulator outputs are root
mean square; amplitudes are √2 times as large unless the TOML says rms = false. Source: LabOne
Programming Manual, "Sweeper Module" (docs.zhinst.com/labone_programming_manual/sweeper_module.html:
scan order, output fields); zhinst.utils.load_labone_demod_csv (docs.zhinst.com/zhinst-utils:
columns of samples); MFLI User Manual, "Signal Processing Basics" (docs.zhinst.com/mfli_user_manual:
X, Y and R in root mean square).
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from femnl.core.errors import MeasurementError
from femnl.io.labfiles.base import RMS, Format, Groups, Sweep, head, sweeps_to_response, text_lines
from femnl.io.labfiles.spec import Spec

_FIELDS = ("frequency", "grid", "x", "y", "r", "phase")
_SAMPLES = {"freq": "frequency", "x": "x", "y": "y"}


def sweep_of(fields: Mapping[str, NDArray[np.float64]], spec: Spec, where: str) -> Sweep:
    """Return the frequency [Hz] and amplitude [V] of one sweep from the sweeper's fields.

    Raises: MeasurementError if they do not suffice.
    """
    sizes = {name: values.size for name, values in fields.items() if name in _FIELDS}
    if len(set(sizes.values())) > 1:
        told = ", ".join(f"{size} values of {name}" for name, size in sizes.items())
        raise MeasurementError(f"{where}: {told}; the file is cut off, export it again")
    frequency = fields.get("frequency", fields.get("grid"))
    if frequency is None:
        raise MeasurementError(
            f"{where}: has neither frequency nor grid; save the sweep with all its fields"
        )
    if "x" in fields and "y" in fields:
        volts = fields["x"] + 1j * fields["y"]
    elif "r" in fields and "phase" in fields:
        volts = fields["r"] * np.exp(1j * fields["phase"])
    else:
        raise MeasurementError(
            f"{where}: has neither x and y nor r and phase; save the sweep with all its fields"
        )
    if np.unique(frequency[np.isfinite(frequency)]).size < 2:
        raise MeasurementError(
            f"{where}: the frequency stands still, so it was not swept; import sweeps of an "
            "oscillator"
        )
    return frequency, np.asarray(volts * (1.0 if spec.rms is False else RMS), dtype=complex)


def _cells(path: Path) -> list[list[str]]:
    first, *others = text_lines(path)
    # The heading itself may be written as a comment
    lines = [first.lstrip("% ")]
    lines += [line for line in others if line.strip() and not line.startswith("%")]
    mark = ";" if ";" in lines[0] else ","
    return [line.split(mark) for line in lines]


def _read(paths: Sequence[Path], spec: Spec) -> tuple[Groups, list[str]]:
    sweeps: list[Sweep] = []
    for path in paths:
        rows = _cells(path)
        heading = [cell.strip().lower() for cell in rows[0]]
        chunks = (
            _by_field(path, rows[1:])
            if "fieldname" in heading
            else _by_sample(path, heading, rows[1:])
        )
        sweeps += [
            sweep_of(fields, spec, f"{path}: chunk {chunk}") for chunk, fields in chunks.items()
        ]
    if not sweeps:
        raise MeasurementError(
            f"{paths[0]}: holds no finished sweep; export it after the sweep has ended"
        )
    dataset, notes = sweeps_to_response(sweeps, {}, spec, str(paths[0]))
    if spec.rms is not False:
        notes.append(f"{paths[0]}: amplitudes are √2 times the root mean square that LabOne stores")
    return {spec.name: dataset}, notes


def _by_field(path: Path, rows: list[list[str]]) -> dict[str, dict[str, NDArray[np.float64]]]:
    chunks: dict[str, dict[str, NDArray[np.float64]]] = {}
    for number, row in enumerate(rows, start=2):
        if len(row) < 4:
            raise MeasurementError(
                f"{path}: line {number} has {len(row)} cells, not chunk, timestamp, size, "
                "fieldname, …; export it again"
            )
        chunk = row[0].strip()
        size = _count(row[2], path, number)
        name = row[3].strip().lower()
        if name in _FIELDS:
            if len(row) - 4 < size:
                raise MeasurementError(
                    f"{path}: line {number} announces {size} values of {name} and has "
                    f"{len(row) - 4}; export it again"
                )
            chunks.setdefault(chunk, {})[name] = _floats(row[4 : 4 + size], path, number)
    return chunks


def _by_sample(
    path: Path, heading: list[str], rows: list[list[str]]
) -> dict[str, dict[str, NDArray[np.float64]]]:
    places = {_SAMPLES[name]: heading.index(name) for name in _SAMPLES if name in heading}
    chunks: dict[str, list[list[str]]] = {}
    for number, row in enumerate(rows, start=2):
        if len(row) < len(heading):
            raise MeasurementError(
                f"{path}: line {number} has {len(row)} cells for {len(heading)} columns; export "
                "it again"
            )
        chunks.setdefault(row[heading.index("chunk")].strip(), []).append(
            [row[place] for place in places.values()]
        )
    columns = {chunk: zip(*lines, strict=True) for chunk, lines in chunks.items()}
    return {
        chunk: {
            name: _floats(list(cells), path, 2) for name, cells in zip(places, column, strict=True)
        }
        for chunk, column in columns.items()
    }


def _count(cell: str, path: Path, number: int) -> int:
    try:
        return int(float(cell))
    except (ValueError, OverflowError):
        raise MeasurementError(
            f"{path}: line {number}: size {cell[:20]!r} is not a number; export it again"
        ) from None


def _floats(cells: list[str], path: Path, number: int) -> NDArray[np.float64]:
    try:
        return np.array([float(cell) for cell in cells])
    except ValueError as error:
        raise MeasurementError(
            f"{path}: line {number}: {str(error)[:60]}; export it again"
        ) from None


def _recognise(path: Path) -> bool:
    start = head(path).lstrip(b"\xef\xbb\xbf% ").lower()
    return start.startswith((b"chunk;timestamp", b"chunk,timestamp"))


FORMAT = Format("LabOne text", _recognise, _read, priority=2)
