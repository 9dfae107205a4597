"""Measurement files of LabVIEW in binary form (.tdms): channels by their name.

Where several groups have a channel of one name, it is "group/channel". A waveform has its times as
well, as "channel time" or "group/channel time", from its own start and increment.
Source: NI, "TDMS File Format Internal Structure"; read by npTDMS.
"""

import logging
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from nptdms.log import log_manager
from nptdms.tdms import TdmsFile
from numpy.typing import NDArray

from femnl.core.errors import MeasurementError
from femnl.io.labfiles.base import Format, Groups, head, need_size, undamaged
from femnl.io.labfiles.columns import one_table
from femnl.io.labfiles.spec import Spec

START = b"TDSm"
INCREMENT = "wf_increment"
BEGINNING = "wf_start_offset"


def _read(paths: Sequence[Path], spec: Spec) -> tuple[Groups, list[str]]:
    cut: list[str] = []

    def table(path: Path) -> dict[str, NDArray[Any]]:
        file = _opened(path)
        status = file.file_status
        if status.incomplete_final_segment or status.channel_statuses:
            cut.append(f"{path}: cut off in its last segment; what it holds before is read")
        return _table(file, path)

    groups, notes = one_table(paths, spec, ".tdms file", table)
    return groups, [*cut, *notes]


def _opened(path: Path) -> TdmsFile:
    """Return the file, read. Raises: MeasurementError for one that is damaged or too large."""
    need_size(path, "split it")
    # What npTDMS prints of a file that is cut off is among the notes
    log_manager.set_level(logging.ERROR)
    file: TdmsFile = undamaged(path, ".tdms file", lambda: TdmsFile.read(path))
    return file


def _table(file: TdmsFile, path: Path) -> dict[str, NDArray[Any]]:
    """Return the channels of numbers."""
    found: dict[str, NDArray[Any]] = {}
    channels = [channel for group in file.groups() for channel in group.channels()]
    alone = Counter(channel.name for channel in channels)
    for channel in channels:
        values = np.asarray(channel[:])
        if values.dtype.kind not in "iufc" or not len(values):
            continue
        name = channel.name
        if alone[name] > 1:
            name = f"{channel.group_name}/{name}"
        found[name] = values
        if INCREMENT in channel.properties:
            first = float(channel.properties.get(BEGINNING, 0.0))
            step = float(channel.properties[INCREMENT])
            found[f"{name} time"] = first + step * np.arange(len(values))
    if not found:
        raise MeasurementError(f"{path}: holds no channel of numbers; export it again")
    return found


FORMAT = Format("LabVIEW TDMS", lambda path: head(path, 4) == START, _read, priority=1)
