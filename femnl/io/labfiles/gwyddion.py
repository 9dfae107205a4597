"""Gwyddion Simple Field (.gsf) images, several of them the harmonics and quadratures of one map.

A file is the line "Gwyddion Simple Field 1.0", header lines "name = value", one to four NUL bytes
up to a multiple of four, then XRes × YRes numbers, 32-bit floats, low byte first, row by row from
the top. Fields: XRes, YRes (required), XReal, YReal (size, default 1), XOffset, YOffset (upper left
corner, default 0), XYUnits, ZUnits (base units, possibly with prefix), Title. Numbers stand for
pixels, so positions are pixel centres; rows run downwards and femnl's y upwards. Without offsets
the origin is the middle of the image. Which file is what the TOML says, [[files]] name, harmonic,
part (real, imag, magnitude or phase in rad); or the file's name does: "map_3f_imag.gsf",
"drum-2f-x.gsf". A missing imaginary part is zero, and a note says so. Source: Gwyddion user guide,
"Simple Field Files" (gwyddion.net/documentation/user-guide-en/gsf.html).
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from femnl.core.errors import MeasurementError
from femnl.io import measurement
from femnl.io.labfiles.base import RMS, Format, Groups, head, need_size, scalar_values
from femnl.io.labfiles.spec import Spec
from femnl.io.measurement import to_si

_MAGIC = b"Gwyddion Simple Field 1.0\n"
_NAME = re.compile(
    r"(?:^|[^0-9A-Za-z])(\d{1,3})f"
    r"(?:[^0-9A-Za-z]+(real|imag|x|y|magnitude|r|phase))?(?:[^0-9A-Za-z]|$)",
    re.IGNORECASE,
)
_PARTS = {
    "real": "real",
    "x": "real",
    "imag": "imag",
    "y": "imag",
    "magnitude": "magnitude",
    "r": "magnitude",
    "phase": "phase",
}


@dataclass(frozen=True)
class Field:
    """One image: x and y of the pixel centres [m], rising; values (y, x) in SI.

    Whether the file gave the origin.
    """

    x: NDArray[np.float64]
    y: NDArray[np.float64]
    values: NDArray[np.float64]
    placed: bool


def read_field(path: Path, unit: str) -> Field:
    """Read one .gsf file whose values are of the given SI unit. Raises: MeasurementError."""
    need_size(path, "crop the image")
    data = path.read_bytes()
    end = data.find(b"\0")
    if not data.startswith(_MAGIC) or end < 0:
        raise MeasurementError(
            f"{path}: header is cut off or not of Gwyddion Simple Field 1.0; export it again"
        )
    lines = data[len(_MAGIC) : end].decode("utf-8", "replace").split("\n")
    header = {
        key.strip(): value.strip()
        for key, mark, value in (line.partition("=") for line in lines)
        if mark
    }
    n_x, n_y = (_number(header, name, path, None) for name in ("XRes", "YRes"))
    if not (n_x >= 1 and n_y >= 1 and n_x == int(n_x) and n_y == int(n_y)):
        raise MeasurementError(
            f"{path}: XRes = {n_x:g}, YRes = {n_y:g} are not counts of pixels; export it again"
        )
    start = end + 4 - end % 4
    if len(data) - start != 4 * int(n_x) * int(n_y):
        raise MeasurementError(
            f"{path}: {len(data) - start} bytes of data where {int(n_x)} × {int(n_y)} pixels need "
            f"{4 * int(n_x * n_y)}; export it again"
        )
    values = (
        np.frombuffer(data, dtype="<f4", offset=start).reshape(int(n_y), int(n_x)).astype(float)
    )
    place = f"{path}: XYUnits"
    width, height = (
        float(to_si(_number(header, name, path, 1.0), header.get("XYUnits", "m"), "m", place))
        for name in ("XReal", "YReal")
    )
    left, top = (
        float(to_si(_number(header, name, path, 0.0), header.get("XYUnits", "m"), "m", place))
        for name in ("XOffset", "YOffset")
    )
    placed = "XOffset" in header or "YOffset" in header
    if not placed:
        left = -width / 2
        top = -height / 2
    x = left + (np.arange(n_x) + 0.5) * width / n_x
    y = -(top + (np.arange(n_y) + 0.5) * height / n_y)
    return Field(
        x, y[::-1], to_si(values[::-1], header.get("ZUnits", unit), unit, f"{path}: ZUnits"), placed
    )


def _number(header: dict[str, str], name: str, path: Path, default: float | None) -> float:
    if name not in header and default is not None:
        return default
    try:
        value = float(header[name])
    except KeyError:
        raise MeasurementError(f"{path}: header field {name} is missing; export it again") from None
    except ValueError:
        raise MeasurementError(
            f"{path}: header field {name} = {header[name][:30]!r} is not a number; correct it"
        ) from None
    if not np.isfinite(value):
        raise MeasurementError(f"{path}: header field {name} = {value:g}; correct it")
    return value


def _role(path: Path, spec: Spec) -> tuple[int, str]:
    """Return the harmonic and part of a file, from the TOML, else from its name."""
    for entry in spec.files:
        if entry.name == path.name:
            return entry.harmonic, entry.part
    match = _NAME.search(path.stem)
    if match is None or spec.files:
        raise MeasurementError(
            f'{path}: harmonic unknown; name it like "map_3f_imag.gsf", or add [[files]] name, '
            "harmonic, part to "
            "the TOML"
        )
    return int(match[1]), _PARTS[(match[2] or "real").lower()]


def _read(paths: Sequence[Path], spec: Spec) -> tuple[Groups, list[str]]:
    parts: dict[tuple[int, str], Field] = {}
    for path in paths:
        role = _role(path, spec)
        if role in parts:
            raise MeasurementError(f"{path}: a second file for {role[1]} of {role[0]}f; remove one")
        parts[role] = read_field(path, "rad" if role[1] == "phase" else "V")
        first = next(iter(parts.values()))
        if not (
            np.allclose(parts[role].x, first.x, rtol=1e-6, atol=0)
            and np.allclose(parts[role].y, first.y, rtol=1e-6, atol=0)
        ):
            raise MeasurementError(
                f"{path}: its pixels do not lie where those of {paths[0].name} do; export all "
                "with the same extent"
            )
    where = str(paths[0].parent)
    notes = []
    if not first.placed:
        notes.append(
            f"{where}: no offsets in the files, the origin is taken in the middle of the image"
        )
    harmonics = sorted({harmonic for harmonic, _ in parts})
    volts = []
    for harmonic in harmonics:
        own = {part: field.values for (n, part), field in parts.items() if n == harmonic}
        if "magnitude" in own:
            if "phase" not in own or len(own) != 2:
                raise MeasurementError(
                    f"{where}: {harmonic}f has magnitude and not just its phase beside it; give "
                    "both, or real and imag"
                )
            volts.append(own["magnitude"] * np.exp(1j * own["phase"]))
        elif "real" in own and "phase" not in own:
            if "imag" not in own:
                notes.append(f"{where}: {harmonic}f has no imaginary part, taken as zero")
            volts.append(own["real"] + 1j * own.get("imag", np.zeros_like(own["real"])))
        else:
            raise MeasurementError(
                f"{where}: {harmonic}f has only {', '.join(own)}; give real and imag, or "
                "magnitude and phase"
            )
    scalars = scalar_values(
        spec, {"noise_sd": "V", "wavelength": "m", "drive": "V", "drive_frequency": "Hz"}, where
    )
    scale = RMS if spec.rms else 1.0
    return {
        spec.name: measurement.harmonic_map(
            first.x, first.y, harmonics, scale * np.array(volts), **scalars
        )
    }, notes


FORMAT = Format(
    "Gwyddion Simple Field", lambda path: head(path, len(_MAGIC)) == _MAGIC, _read, priority=2
)
