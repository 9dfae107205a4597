"""Feed mutated bytes to one reader.

`python fuzz.py geometry|measurement|structure SEEDS FLAGS…`, flags as of libFuzzer.

`geometry` and `measurement` take the bytes for a file's; `structure` makes HDF5 of them that is
sound and holds anything.

Ends with a status other than 0 at the first traceback, hang or message of more than one line, and
prints the bytes.
"""

import sys
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import h5py
import numpy as np

atheris = import_module("atheris")  # without types, and only there where the fuzzers run

with atheris.instrument_imports(
    include=["tomllib", "femnl.device.geometry", "femnl.io.measurement"]
):
    from femnl.core.errors import GeometryError, MeasurementError
    from femnl.device import geometry
    from femnl.io import measurement
    from femnl.io.measurement.contract import KINDS

    geometry.shipped()


def check(line: str) -> None:
    """One line of bounded length is all that a user gets."""
    if len(line.splitlines()) != 1 or len(line) > 2000:
        raise RuntimeError(f"not one line: {line!r}")


def read_geometry(data: bytes) -> None:
    """Parse bytes as a geometry file."""
    try:
        geometry.parse(data.decode("utf-8", "replace"))
    except GeometryError as error:
        check(str(error))


def read_measurement(data: bytes) -> None:
    """Read bytes as a measurement file, and write again what was understood."""
    path = FOLDER / "file.nc"
    path.write_bytes(data)
    try:
        measurement.write(measurement.read(path), FOLDER / "again.nc")
        measurement.read(FOLDER / "again.nc")
    except MeasurementError as error:
        check(str(error))


NAMES = sorted(
    {name for kind in KINDS.values() for name in [*kind.datasets, *kind.attributes]}
    | {"kind", "units", "stranger"}
)
TYPES = ["f8", "f4", "i8", "u1", "?", "c16", "S3"]
WORDS = [
    *KINDS,
    "",
    "m",
    "nm",
    "V",
    "Hz",
    "1/s",
    "632.8 nm",
    "m**9",
    "é",
    "1e400 m",
    "nan",
    "<script>",
    "../x.toml",
]


def values(data: Any) -> object:
    """Something that an attribute or a dataset can hold."""
    choice = data.ConsumeIntInRange(0, 4)
    if choice == 0:
        return data.PickValueInList(WORDS)
    if choice == 1:
        return data.PickValueInList([0.0, -1.0, 1.0, 1e-9, 1e6, 1e308, np.nan, np.inf, 2**62, True])
    shape = tuple(data.ConsumeIntInRange(0, 5) for _ in range(data.ConsumeIntInRange(0, 4)))
    kind = np.dtype(data.PickValueInList(TYPES))
    size = int(np.prod(shape)) * kind.itemsize
    content = (
        np.frombuffer(data.ConsumeBytes(size).ljust(size, b"\1"), dtype="u1")
        .view(kind)
        .reshape(shape)
    )
    return np.sort(content.ravel()).reshape(shape) if choice == 2 and kind.kind in "fi" else content


def read_structure(data: bytes) -> None:
    """Build a measurement file with a little of everything, and read it."""
    given = atheris.FuzzedDataProvider(data)
    with h5py.File(FOLDER / "made.nc", "w") as file:
        file.attrs["femnl_measurement"] = "1.0"
        for k in range(given.ConsumeIntInRange(1, 2)):
            kind = given.PickValueInList(list(KINDS))
            group = file.create_group(f"g{k}")
            group.attrs["kind"] = kind
            own = [*KINDS[kind].datasets]
            for name in (
                own[: given.ConsumeIntInRange(0, len(own))]
                if given.ConsumeBool()
                else given.PickValueInList([own, NAMES[:5]])
            ):
                group[name] = values(given)
                if given.ConsumeBool():
                    group[name].attrs["units"] = given.PickValueInList(WORDS)
            for _ in range(given.ConsumeIntInRange(0, 3)):
                group.attrs[given.PickValueInList(NAMES)] = values(given)
    try:
        measurement.write(measurement.read(FOLDER / "made.nc"), FOLDER / "again.nc")
        measurement.read(FOLDER / "again.nc")
    except MeasurementError as error:
        check(str(error))


if __name__ == "__main__":
    h5py._errors.silence_errors()
    with TemporaryDirectory() as folder:
        FOLDER = Path(folder)
        target = {
            "geometry": read_geometry,
            "measurement": read_measurement,
            "structure": read_structure,
        }[sys.argv[1]]
        atheris.Setup([sys.argv[0], *sys.argv[2:]], target)
        atheris.Fuzz()
