"""Recordings (.wav): channels by number from 1, the time from their rate.

Integers count as parts of full scale, which is 1 V unless the column's unit says otherwise.
Source: IBM and Microsoft, "Multimedia Programming Interface and Data Specifications 1.0", RIFF.
"""

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.io import wavfile

from femnl.core.errors import MeasurementError
from femnl.io.labfiles.base import Format, Groups, head, need_size, undamaged
from femnl.io.labfiles.named_columns import take_columns, unread
from femnl.io.labfiles.spec import Spec
from femnl.io.labfiles.tables import to_dataset


def _read(paths: Sequence[Path], spec: Spec) -> tuple[Groups, list[str]]:
    if len(paths) > 1:
        raise MeasurementError(f"{paths[1]}: one recording at a time; import each on its own")
    where = str(paths[0])
    rate, table, notes = _table(paths[0])
    if spec.kind is None:
        spec = spec.model_copy(update={"kind": "trace", "columns": {"time": "time", "voltage": 1}})
    elif "time" not in spec.columns:
        spec = spec.model_copy(update={"columns": {**spec.columns, "time": "time"}})
    dataset, told = to_dataset(spec, take_columns(spec, table, where), where)
    notes.append(f"{where}: samples at {rate} Hz, as the file says")
    return {spec.name: dataset}, [*notes, *told, *unread(spec, table, where)]


def _table(path: Path) -> tuple[int, dict[str, NDArray[Any]], list[str]]:
    """Return the rate [Hz], the channels and the time, and what was assumed."""
    need_size(path, "split it")
    with warnings.catch_warnings():
        # Chunks that are no sound, such as comments, are of no interest
        warnings.simplefilter("ignore", wavfile.WavFileWarning)
        rate, values = undamaged(path, "plain recording", lambda: wavfile.read(path))
    notes = []
    samples = np.asarray(values)
    if not samples.size or rate < 1:
        raise MeasurementError(
            f"{path}: {len(samples)} samples at {rate} Hz are no recording; save it again"
        )
    if samples.dtype.kind in "iu":
        middle = 128 if samples.dtype == np.uint8 else 0
        full = 128.0 if samples.dtype == np.uint8 else float(np.iinfo(samples.dtype).max) + 1
        samples = (samples.astype(float) - middle) / full
        notes.append(f"{path}: integers are taken as parts of a full scale of 1 V")
    columns = samples.reshape(len(samples), -1).astype(float)
    table = {str(number): column for number, column in enumerate(columns.T, start=1)}
    return int(rate), {**table, "time": np.arange(len(samples)) / rate}, notes


FORMAT = Format(
    "recording", lambda path: head(path)[:4] == b"RIFF" and head(path)[8:12] == b"WAVE", _read, 1
)
