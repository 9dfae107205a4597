"""Scans of Nanonis controllers (.sxm): the lock-in's images of a film as the harmonic of a map.

A text head of tags ":NAME:", each with lines of values, ends with ":SCANIT_END:"; then come the
bytes 1A 04 and the images, 32-bit floats, high byte first, row by row, in the order of the channels
of DATA_INFO (columns Channel, Name, Unit, Direction, Calibration, Offset, separated by tabs). A
channel of direction "both" has the image of the way forward and then that of the way back, whose
rows run from right to left. SCAN_DIR "up" begins with the lowest row, "down" with the uppermost.
SCAN_PIXELS and SCAN_RANGE [m] are along x and y, SCAN_OFFSET [m] is the centre of the scan,
SCAN_ANGLE [deg] its turn. Numbers are in the unit of their channel already.

The TOML beside the file says which channels are the amplitude; "NAME back" is the way back. Source:
"Nanonis File Format Version 1" (sourceforge.net/p/gxsm/plugin-requests/3); for the byte order, the
start of the data and the order of rows, the readers of Gwyddion (modules/file/nanonis.c) and of
nanonispy.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from femnl.core.errors import MeasurementError
from femnl.io.labfiles.base import Format, Groups, head, need_size
from femnl.io.labfiles.columns import one_table
from femnl.io.labfiles.named_columns import in_own_units
from femnl.io.labfiles.spec import Spec

START = b":NANONIS_VERSION:"
END = b":SCANIT_END:"
MARK = b"\x1a\x04"
BYTES = 4
"""Bytes of a number."""
LAYOUT = ("Channel", "Name", "Unit", "Direction", "Calibration", "Offset")
WAYS: Mapping[str, tuple[bool, ...]] = {
    "both": (False, True),
    "forward": (False,),
    "fwd": (False,),
    "backward": (True,),
    "bwd": (True,),
}
"""Images of a channel by its direction: whether each was taken on the way back."""


@dataclass(frozen=True)
class Channel:
    """One image: its name, the unit of its numbers, and whether it was taken on the way back."""

    name: str
    unit: str
    back: bool

    @property
    def column(self) -> str:
        """What a TOML calls it."""
        return f"{self.name} back" if self.back else self.name


def _read(paths: Sequence[Path], spec: Spec) -> tuple[Groups, list[str]]:
    path = paths[0]
    need_size(path, "scan fewer pixels")
    data = path.read_bytes()
    tags = _tags(data, path)
    units = {"x": "m", "y": "m"} | {one.column: one.unit for one in _channels(tags, path)}
    groups, notes = one_table(
        paths, in_own_units(spec, units), "Nanonis scan", lambda _: _table(data, path)
    )
    (angle,) = _numbers(tags, "SCAN_ANGLE", 1, path)
    if angle:
        notes.append(
            f"{path}: the scan is turned by {angle:g} deg; x and y are along its own edges"
        )
    return groups, notes


def _tags(data: bytes, path: Path) -> dict[str, list[str]]:
    """Return the lines of values of each tag. Raises: MeasurementError where no head ends."""
    end = data.find(END)
    if end < 0:
        raise MeasurementError(f"{path}: its head has no :SCANIT_END:; copy the file again")
    found: dict[str, list[str]] = {}
    lines: list[str] = []
    for line in data[:end].decode("utf-8", "replace").splitlines():
        name = line.strip()
        if len(name) > 2 and name.startswith(":") and name.endswith(":"):
            lines = found.setdefault(name[1:-1], [])
        else:
            lines.append(line)
    return found


def _numbers(tags: Mapping[str, list[str]], name: str, count: int, path: Path) -> list[float]:
    """Return the numbers of a tag. Raises: MeasurementError for other than so many finite ones."""
    words = " ".join(tags.get(name, [])).split()
    try:
        found = [float(word) for word in words]
    except ValueError:
        found = []
    if len(found) != count or not np.all(np.isfinite(found)):
        raise MeasurementError(
            f"{path}: {name} = {' '.join(words)[:40]!r}: needs {count} finite numbers; save the "
            "scan again"
        )
    return found


def _channels(tags: Mapping[str, list[str]], path: Path) -> list[Channel]:
    """Return the images in their order. Raises: MeasurementError for another table of channels."""
    rows = [line.strip().split("\t") for line in tags.get("DATA_INFO", []) if line.strip()]
    if not rows or tuple(rows[0][: len(LAYOUT)]) != LAYOUT:
        raise MeasurementError(
            f"{path}: DATA_INFO does not begin with the columns {', '.join(LAYOUT)}; save the "
            "scan again"
        )
    found = []
    for row in rows[1:]:
        if len(row) < len(LAYOUT) or row[3] not in WAYS:
            raise MeasurementError(
                f"{path}: DATA_INFO: {' '.join(row)[:60]!r} is no channel with a direction of "
                f"{', '.join(WAYS)}; save the scan again"
            )
        found += [Channel(row[1], row[2], back) for back in WAYS[row[3]]]
    return found


def _table(data: bytes, path: Path) -> dict[str, NDArray[Any]]:
    """Return x and y [m] of every pixel, and the images, each as a column (n_x n_y,)."""
    tags = _tags(data, path)
    channels = _channels(tags, path)
    form = " ".join(tags.get("SCANIT_TYPE", [])).split()
    if form != ["FLOAT", "MSBFIRST"]:
        raise MeasurementError(
            f"{path}: SCANIT_TYPE = {' '.join(form)[:40]!r}; only FLOAT MSBFIRST is read: save "
            "the scan with a newer Nanonis"
        )
    n_x, n_y = _pixels(tags, path)
    begin = data.find(MARK, data.find(END)) + len(MARK)
    needed = len(channels) * n_x * n_y * BYTES
    if begin < len(MARK) or len(data) - begin != needed:
        raise MeasurementError(
            f"{path}: {max(len(data) - begin, 0)} bytes of data where {len(channels)} images of "
            f"{n_x} × {n_y} pixels need {needed}; copy the file again"
        )
    images = np.frombuffer(data, ">f4", offset=begin).reshape(len(channels), n_y, n_x)
    table = dict(zip(("x", "y"), _places(tags, n_x, n_y, path), strict=True))
    for channel, image in zip(channels, images.astype(float), strict=True):
        table[channel.column] = (image[:, ::-1] if channel.back else image).ravel()
    return table


def _pixels(tags: Mapping[str, list[str]], path: Path) -> tuple[int, int]:
    """Return the numbers of pixels along x and y."""
    found = _numbers(tags, "SCAN_PIXELS", 2, path)
    if any(count < 1 or count != int(count) for count in found):
        raise MeasurementError(
            f"{path}: SCAN_PIXELS = {found[0]:g}, {found[1]:g}: no counts of pixels; save the "
            "scan again"
        )
    return int(found[0]), int(found[1])


def _places(
    tags: Mapping[str, list[str]], n_x: int, n_y: int, path: Path
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return x and y [m] of the pixels' centres, each (n_x n_y,), row by row as stored."""
    width, height = _numbers(tags, "SCAN_RANGE", 2, path)
    centre = _numbers(tags, "SCAN_OFFSET", 2, path)
    direction = " ".join(tags.get("SCAN_DIR", [])).strip()
    if direction not in ("up", "down"):
        raise MeasurementError(
            f"{path}: SCAN_DIR = {direction[:20]!r}: must be up or down; save the scan again"
        )
    x = centre[0] + width * ((np.arange(n_x) + 0.5) / n_x - 0.5)
    y = centre[1] + height * ((np.arange(n_y) + 0.5) / n_y - 0.5)
    if direction == "down":
        y = y[::-1]
    return np.tile(x, n_y), np.repeat(y, n_x)


FORMAT = Format("Nanonis scan", lambda path: head(path, len(START)) == START, _read, priority=2)
