"""Gwyddion's own files become maps; what cannot be read is refused in one line."""

import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from femnl.core.errors import MeasurementError
from femnl.io import measurement
from femnl.io.labfiles import Spec, import_file

IMAGE = np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]])
"""Rows from the top."""


def component(name: str, kind: str, value: bytes) -> bytes:
    """Write a component as Gwyddion's page says."""
    return name.encode() + b"\0" + kind.encode() + value


def built(name: str, *components: bytes) -> bytes:
    """Write an object."""
    body = b"".join(components)
    return name.encode() + b"\0" + struct.pack("<I", len(body)) + body


def text(words: str) -> bytes:
    """Write a text."""
    return words.encode() + b"\0"


def field(values: NDArray[np.float64], unit: str = "V", width: float = 6e-6, **more: Any) -> bytes:
    """Write an image whose upper left corner lies at (1, −2) µm."""
    given: dict[str, Any] = {"xreal": width, "yreal": 4e-6, "xoff": 1e-6, "yoff": -2e-6} | more
    numbers = [component(name, "d", struct.pack("<d", one)) for name, one in given.items()]
    data = struct.pack("<I", values.size) + values.astype("<f8").tobytes()
    return built(
        "GwyDataField",
        component("xres", "i", struct.pack("<i", values.shape[1])),
        component("yres", "i", struct.pack("<i", values.shape[0])),
        *numbers,
        component("si_unit_xy", "o", built("GwySIUnit", component("unitstr", "s", text("m")))),
        component("si_unit_z", "o", built("GwySIUnit", component("unitstr", "s", text(unit)))),
        component("data", "D", data),
    )


def file(path: Path, *more: bytes, **images: bytes) -> Path:
    """Write a file of images by title, between components that are of no interest."""
    odd = [
        component("/filename", "s", text("a.gwy")),
        component("/0/mask", "o", built("GwyDataField")),
        component("/0/data/visible", "b", b"\1"),
        component("words", "S", struct.pack("<I", 2) + text("a") + text("b")),
        component("objects", "O", struct.pack("<I", 1) + built("GwySIUnit")),
    ]
    shown = []
    for k, (title, image) in enumerate(images.items()):
        shown.append(component(f"/{k}/data", "o", image))
        shown.append(component(f"/{k}/data/title", "s", text(title)))
    path.write_bytes(b"GWYP" + built("GwyContainer", *odd, *shown, *more))
    return path


def spec(**columns: str) -> Spec:
    """Return the description of a map of the third harmonic."""
    named = {"x": "x", "y": "y", "real": "X", "imag": "Y"} | columns
    found = {"kind": "map", "columns": named, "values": {"harmonic": 3}}
    return Spec.model_validate(found)


def test_images_become_a_map_with_their_places_and_units(tmp_path: Path) -> None:
    images = {"Z": field(IMAGE, "m", 9e-6), "X": field(IMAGE), "Y": field(2000 * IMAGE, "mV")}
    tree = import_file(file(tmp_path / "a.gwy", **images), tmp_path / "a.nc", spec())
    found = tree["measurement"].to_dataset()
    assert found["harmonic"].values.tolist() == [3]
    np.testing.assert_allclose(found["x"].values, [2e-6, 4e-6, 6e-6])
    np.testing.assert_allclose(found["y"].values, [-1e-6, 1e-6])
    np.testing.assert_allclose(measurement.amplitude(found).values, [(1 + 2j) * IMAGE[::-1]])


def test_a_height_is_no_voltage(tmp_path: Path) -> None:
    path = file(tmp_path / "a.gwy", X=field(IMAGE, "m"), Y=field(IMAGE))
    with pytest.raises(MeasurementError, match="unit 'm' is not a unit of this quantity"):
        import_file(path, tmp_path / "a.nc", spec())


@pytest.mark.parametrize(
    ("images", "more", "told"),
    [
        ({}, (), "holds no image"),
        ({"X": field(IMAGE), "Y": field(IMAGE, width=5e-6)}, (), "'Y' does not lie where 'X' does"),
        ({"X": field(IMAGE, xreal=np.nan), "Y": field(IMAGE)}, (), "xreal = nan: must be finite"),
        ({"X": field(IMAGE[:0]), "Y": field(IMAGE)}, (), "image 'X': has no pixels"),
        ({"X": built("GwyDataField")}, (), "xres is missing"),
        ({"X": field(IMAGE)}, (), "no column 'Y'; the file has x, y, X"),
        ({"X": field(IMAGE)}, (component("odd", "?", b"\0\0\0\0"),), "a component of type '\\?'"),
        ({"X": field(IMAGE)}, (component("odd", "D", b"\xff\xff\xff\x7f"),), "cut off or damaged"),
        ({"X": field(IMAGE)}, (component("/9/data", "o", field(IMAGE)),) * 2, "no column 'Y'"),
    ],
)
def test_what_cannot_be_read_is_refused_in_one_line(
    images: dict[str, bytes], more: tuple[bytes, ...], told: str, tmp_path: Path
) -> None:
    path = file(tmp_path / "a.gwy", *more, **images)
    with pytest.raises(MeasurementError, match=told) as caught:
        import_file(path, tmp_path / "a.nc", spec())
    assert "\n" not in str(caught.value)


def test_two_images_of_one_title_are_refused(tmp_path: Path) -> None:
    title = component("/9/data/title", "s", text("X"))
    more = (component("/9/data", "o", field(IMAGE)), title)
    path = file(tmp_path / "a.gwy", *more, X=field(IMAGE))
    with pytest.raises(MeasurementError, match="two images are called 'X'"):
        import_file(path, tmp_path / "a.nc", spec())


def test_values_of_another_number_than_pixels_are_refused(tmp_path: Path) -> None:
    short = field(IMAGE).replace(struct.pack("<i", 3), struct.pack("<i", 4), 1)
    path = file(tmp_path / "a.gwy", X=short, Y=field(IMAGE))
    with pytest.raises(MeasurementError, match="6 values where 4 × 2 pixels need 8"):
        import_file(path, tmp_path / "a.nc", spec())


def test_a_file_that_is_cut_off_anywhere_is_refused(tmp_path: Path) -> None:
    path = file(tmp_path / "a.gwy", X=field(IMAGE), Y=field(IMAGE))
    whole = path.read_bytes()
    for size in range(4, len(whole)):
        path.write_bytes(whole[:size])
        with pytest.raises(MeasurementError, match="cut off or damaged"):
            import_file(path, tmp_path / "a.nc", spec())


def test_images_a_tenth_of_a_pixel_apart_are_not_alike(tmp_path: Path) -> None:
    first = field(IMAGE, width=1e-7, yreal=1e-7)
    shifted = field(IMAGE, width=1e-7, yreal=1e-7, xoff=1.009e-6)
    path = file(tmp_path / "a.gwy", X=first, Y=shifted)
    with pytest.raises(MeasurementError, match="image 'Y' does not lie where 'X' does"):
        import_file(path, tmp_path / "a.nc", spec())
