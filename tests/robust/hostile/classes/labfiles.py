"""Lab files of odd shapes, classes and sizes, whole ones that were damaged, and none at all."""

import io
import wave
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from scipy.io import savemat

from tests.robust.hostile.files import Array, pick

KINDS = ["spectrum", "response", "map", "trace", "series", "decay"]
COLUMNS = {
    "spectrum": ["frequency", "frequency_sd"],
    "response": ["frequency", "real", "imag"],
    "map": ["x", "y", "real", "imag"],
    "trace": ["time", "voltage"],
    "series": ["pressure", "quality_factor"],
    "decay": ["time", "power"],
}
DIGITS = [
    "١٢٣",
    "\uff11\uff12",
    "१२",
    "1e999",
    "1_000",
    "0x1p3",
    "1,5",
    "--1",
    "1d3",
    "∞",
    "NaN",
    "inf",
    "",
]


def odd_array(rng: np.random.Generator) -> Any:
    """Return a value of an odd shape or class, as a MATLAB file may hold."""
    shapes = [
        (0, 0),
        (0,),
        (1, 1),
        (1, 20),
        (20, 1),
        (3, 20),
        (20, 20),
        (2, 3, 4),
        (20, 0),
        (1, 1, 20),
    ]
    shape = pick(rng, shapes)
    plain = rng.normal(size=shape) + 2
    choices = [
        plain,
        plain,
        np.sort(np.abs(plain).ravel()),
        plain + 1j,
        plain.astype(np.float32),
        plain.astype(np.int8),
        plain > 0,
        "text",
        ["a", "bc"],
        {"a": 1.0, "b": {"c": [1, 2]}},
        np.empty((0, 0), dtype=object),
        np.array([[1.0, "x"], [np.zeros(0), {}]], dtype=object),
        np.array([np.zeros(0), np.ones(3)], dtype=object),
        np.array([(1, 2.0)], dtype=[("a", "i4"), ("b", "f8")]),
        np.full(shape, np.nan),
        np.full(shape, np.inf),
        np.zeros(shape),
        7.0,
    ]
    return choices[int(rng.integers(len(choices)))]


def _spec(rng: np.random.Generator, folder: Path, names: list[str], stem: str = "t") -> str:
    """Write a TOML beside a file that takes some of its columns, rightly or not."""
    kind = pick(rng, KINDS)
    wanted = COLUMNS[kind] + [
        name for name in ("drive", "direction", "harmonic", "time") if rng.random() < 0.1
    ]
    lines = [f'kind = "{kind}"', *(["header = false"] if rng.random() < 0.1 else [])]
    lines += [f"skip = {int(rng.integers(9))}"] if rng.random() < 0.1 else []
    lines.append("[columns]")
    for name in dict.fromkeys(wanted):
        column = pick(rng, names) if names else "a"
        form = f'"{column}"'
        if rng.random() < 0.1:
            form = (
                f'{{ column = "{column}", unit = "{pick(rng, ["kHz", "mV", "dBm", "s", "m"])}" }}'
            )
        elif rng.random() < 0.05:
            form = f'{{ rate = "{pick(rng, ["1 MHz", "0 Hz", "-1 Hz", "1e-300 Hz"])}" }}'
        elif rng.random() < 0.05:
            form = f'{{ column = "{column}", round = "{pick(rng, ["0 m", "1 um", "1e-300 V"])}" }}'
        lines.append(f"{name} = {form}")
    if rng.random() < 0.2:
        value = pick(rng, ["0", "-1", '"x"', "[1, 2]", "1e300", "nan"])
        lines += ["[values]", f"noise_sd = {value}"]
    (folder / f"{stem}.toml").write_text("\n".join(lines), encoding="utf-8")
    return f"{stem}.toml"


def _mat5(rng: np.random.Generator, folder: Path) -> str:
    names = ["a", "b", "c"]
    savemat(
        folder / "t.mat",
        {name: odd_array(rng) for name in names},
        do_compression=bool(rng.integers(2)),
    )
    _spec(rng, folder, names)
    return "t.mat"


def _mat73(rng: np.random.Generator, folder: Path) -> str:
    path = folder / "t.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        for name in ("a", "b", "c"):
            _node(rng, file, name)
    content = path.read_bytes()
    head = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM"
    path.write_bytes(head.ljust(512, b"\0") + content[512:])
    _spec(rng, folder, ["a", "b", "c"])
    return "t.mat"


def _node(rng: np.random.Generator, file: Any, name: str) -> None:
    """Write one variable of a MATLAB 7.3 file, rightly or not."""
    way = int(rng.integers(9))
    label: Any = b"double"
    if way == 0:
        file.create_group(name)
        label = b"struct"
    elif way == 1:
        file[name] = np.array([1, 2], dtype="u8")
        file[name].attrs["MATLAB_empty"] = 1
    elif way == 2:
        file[name] = np.array([(1.0, 2.0)] * 20, dtype=[("real", "f8"), ("imag", "f8")])
    elif way == 3:
        file[name] = np.array([(1.0, 2.0)] * 20, dtype=[("re", "f8"), ("im", "f8")])
    elif way == 4:
        file[name] = h5py.Empty("f8")
    elif way == 5:
        file[name] = "text"
        label = pick(rng, [b"char", b"cell", b"double"])
    elif way == 6:
        file.create_dataset(name, data=np.array([b"a", b"b"]), dtype="S1")
    else:
        file[name] = rng.normal(
            size=pick(rng, [(1, 20), (20, 1), (3, 20), (20,), (2, 2, 2), (0, 3)])
        )
    if rng.random() < 0.7:
        odd = [label, label, 7, np.array([b"double", b"x"]), np.array([1.0, 2.0]), b"\xff"]
        file[name].attrs["MATLAB_class"] = pick(rng, odd)


def _labone_hdf5(rng: np.random.Generator, folder: Path) -> str:
    fields = ["timestamp", "frequency", "grid", "x", "y", "r", "phase", "value"]
    with h5py.File(folder / "t.h5", "w") as file:
        for chunk in pick(
            rng, [["000"], ["000", "001"], ["000", "x"], ["²", "000"], ["000", "0000"], []]
        ):
            places = ["dev1/demods/0/sample", "sample", "dev1/demods/0/sample.x", "sample.x.avg"]
            group = file.create_group(f"{chunk}/{pick(rng, places)}")
            for name in fields:
                if rng.random() < 0.6:
                    size = int(pick(rng, [0, 1, 2, 30, 30, 30, 31]))
                    way = rng.random()
                    if way < 0.75:
                        values: Any = np.sort(rng.normal(size=size)) + 1e6
                    elif way < 0.8:
                        values = np.full(size, np.nan)
                    elif way < 0.85:
                        values = h5py.Empty("f8")
                    elif way < 0.9:
                        values = "text"
                    else:
                        values = np.arange(size * 2, dtype="u8").reshape(size, 2)
                    group[name] = values
    lines = []
    if rng.random() < 0.6:
        lines.append(f'clockbase = "{pick(rng, ["60 MHz", "0 Hz", "-1 Hz", "x"])}"')
    if rng.random() < 0.3:
        lines.append('signal = "sample.x.avg"')
    (folder / "t.toml").write_text("\n".join(lines), encoding="utf-8")
    return "t.h5"


def _labone_csv(rng: np.random.Generator, folder: Path) -> str:
    mark = pick(rng, [";", ","])
    lines = [
        mark.join(
            [
                "chunk",
                "timestamp",
                *pick(rng, [["size", "fieldname"], ["x", "y", "freq"], ["x"], ["size"]]),
            ]
        )
    ]
    for chunk in range(int(rng.integers(3))):
        for name in ("frequency", "grid", "x", "y", "r", "phase"):
            if rng.random() < 0.7:
                count = int(pick(rng, [0, 1, 20, 20, 20]))
                numbers = [f"{x:.9g}" for x in 1e6 + np.arange(count)]
                if rng.random() < 0.1 and numbers:
                    numbers[0] = pick(rng, DIGITS)
                size = pick(rng, [str(count), str(count), "-1", "1e300", "nan", "x", "99"])
                lines.append(mark.join([str(chunk), "0", size, name, *numbers]))
    if rng.random() < 0.2:
        lines.append(pick(rng, ["", ";", "a", ";;;;", "\x00"]))
    (folder / "t.csv").write_text("\n".join(lines), encoding="utf-8")
    return "t.csv"


def _csv(rng: np.random.Generator, folder: Path) -> str:
    names = ["a", "b", "c", "d"][: int(rng.integers(1, 5))]
    mark = pick(rng, [",", ";", "\t", " "])
    rows = [[f"{x:.6g}" for x in np.sort(np.abs(rng.normal(size=len(names))))] for _ in range(30)]
    way = int(rng.integers(12))
    if way == 0:
        rows = []
    elif way == 1:
        rows = rows[:1]
    elif way == 2:
        rows[3] = rows[3][:-1]
    elif way == 3:
        rows[3] = [*rows[3], "1"]
    elif way == 4:
        rows[int(rng.integers(30))][0] = pick(rng, DIGITS)
    elif way == 5:
        rows = [["1"] * 100_000]
        names = [str(k) for k in range(100_000)]
    elif way == 6:
        rows = [["1" * 1_000_000]]
    elif way == 7:
        names = [*names[:-1], '"open']
    elif way == 8:
        rows = [[pick(rng, DIGITS) for _ in names] for _ in range(20)]
    elif way == 9:
        names = []
    elif way == 10:
        rows[4] = ["nan"] * len(names)
    text = "\n".join(mark.join(row) for row in [names, *rows])
    (folder / "t.csv").write_text(text, encoding="utf-8")
    _spec(rng, folder, names[:5])
    return "t.csv"


def _lvm(rng: np.random.Generator, folder: Path) -> str:
    end = pick(rng, ["***End_of_Header***", "***End_of_Header***", "***End***"])
    separator = pick(rng, ["Tab", "Comma", "None", "Semicolon"])
    head = f"LabVIEW Measurement\t\nSeparator\t{separator}\nDecimal_Separator\t.\n{end}\n"
    body = "X_Value\ta\tComment\n" + "\n".join(f"{k}\t{k}" for k in range(int(rng.integers(30))))
    body += pick(rng, ["", "\n\t\t\t", "\nx\ty", f"\n{pick(rng, DIGITS)}\t1", "\n1"])
    (folder / "t.lvm").write_text(head * int(rng.integers(1, 4)) + body, encoding="utf-8")
    _spec(rng, folder, ["X_Value", "a"])
    return "t.lvm"


def _analyser(rng: np.random.Generator, folder: Path) -> str:
    heads = [
        "% time [s], power [dBm]",
        "% time [], power []",
        "% time [s], time [s]",
        "% power [dBm], x [V]",
        "% frequency [Hz], power [dBm]",
        "% time [furlong], magnitude [V]",
        "% time [s], real [V]",
    ]
    entries = [
        "% Frequency [Hz]: x",
        "% Pressure [mBar]: 1e400",
        "% Frequency [Hz]: -1",
        "% Notes:",
        "% Sample ID: a",
        "% Temperature [K]: 1e-400",
        "% Bandwidth [Hz]: 10 Hz",
        "% Pressure []: 3",
    ]
    lines = [str(pick(rng, entries)) for _ in range(int(rng.integers(4)))] + [pick(rng, heads)]
    for k in range(int(pick(rng, [0, 2, 40, 400]))):
        row = [f"{k * 0.1:.3f}", f"{-50 - k * 0.1:.3f}"]
        if rng.random() < 0.01:
            row[int(rng.integers(2))] = pick(rng, DIGITS)
        lines.append(",".join(row))
    (folder / "t.txt").write_text("\n".join(lines), encoding="utf-8")
    return "t.txt"


def _gsf(rng: np.random.Generator, folder: Path) -> str:
    nx = int(pick(rng, [1, 2, 8, 12]))
    ny = int(pick(rng, [1, 2, 8, 12]))
    odd = pick(
        rng,
        [
            "",
            "",
            "XReal = 0\n",
            "XReal = nan\n",
            "XReal = -1\n",
            "XYUnits = V\n",
            "XOffset = 1e300\n",
            "ZUnits = m\n",
            "XReal = 1e-300\n",
        ],
    )
    width = pick(rng, [str(nx), str(nx), str(nx), "0", "-1", "x", "1e30", "٣"])
    head = f"Gwyddion Simple Field 1.0\nXRes = {width}\nYRes = {ny}\n{odd}"
    content = head.encode()
    content += b"\0" * (4 - len(content) % 4)
    values = pick(
        rng,
        [
            rng.normal(size=(ny, nx)),
            np.zeros((ny, nx)),
            np.full((ny, nx), np.nan),
            np.full((ny, nx), 3e38),
        ],
    )
    content += values.astype("<f4").tobytes()
    (folder / pick(rng, ["m_1f.gsf", "m_0f.gsf", "m.gsf", "m_999f_imag.gsf"])).write_bytes(content)
    return next(folder.glob("*.gsf")).name


def _npy(rng: np.random.Generator, folder: Path) -> str:
    values: Array = pick(
        rng,
        [
            rng.normal(size=(30, 3)),
            rng.normal(size=(3, 30)),
            np.zeros((0, 3)),
            np.zeros(0),
            np.array(1.0),
            np.zeros((3, 30), dtype="S3"),
            np.zeros((2, 2, 2)),
            np.zeros(30, dtype=[("a", "f8"), ("b", "f8", (3,))]),
            np.zeros(30, dtype=[("a", "S4"), ("b", "c16")]),
            np.zeros((3, 30), dtype="M8[s]"),
            np.full((3, 30), np.inf),
            np.zeros((3, 30), dtype="f2"),
            np.zeros((3, 30), dtype=bool),
            np.zeros((3, 30), dtype="g"),
        ],
    )
    np.save(folder / "t.npy", values)
    _spec(rng, folder, ["1", "2", "3", "a", "b"])
    return "t.npy"


def _wav(rng: np.random.Generator, folder: Path) -> str:
    stream = io.BytesIO()
    with wave.open(stream, "wb") as sound:
        sound.setnchannels(int(pick(rng, [1, 2])))
        sound.setsampwidth(int(pick(rng, [1, 2, 3, 4])))
        sound.setframerate(int(pick(rng, [1, 44100])))
        sound.writeframes(rng.bytes(int(pick(rng, [0, 24, 2400]))))
    content = bytearray(stream.getvalue())
    if rng.random() < 0.4:
        content[int(rng.integers(12, 44))] = int(rng.integers(256))
    (folder / "t.wav").write_bytes(bytes(content))
    if rng.random() < 0.4:
        _spec(rng, folder, ["1", "2"])
    return "t.wav"


MAKERS = [_mat5, _mat73, _labone_hdf5, _labone_csv, _csv, _csv, _lvm, _analyser, _gsf, _npy, _wav]


def _damage(rng: np.random.Generator, path: Path) -> None:
    """Flip, cut, repeat or insert bytes of a file."""
    content = bytearray(path.read_bytes())
    if len(content) > 200_000:
        return
    way = int(rng.integers(4))
    at = int(rng.integers(len(content) + 1))
    if way == 0:
        content = content[:at]
    elif way == 1 and content:
        for place in rng.integers(len(content), size=int(rng.integers(1, 20))):
            content[int(place)] = int(rng.integers(256))
    elif way == 2:
        content[at:at] = content[:at]
    else:
        content[at:at] = rng.bytes(int(rng.integers(1, 100)))
    path.write_bytes(bytes(content))


def make(rng: np.random.Generator, folder: Path) -> list[str]:
    """Write a lab file, damage it now and then, and import or fit it."""
    maker = MAKERS[int(rng.integers(len(MAKERS)))]
    name = maker(rng, folder)
    if rng.random() < 0.25:
        _damage(rng, folder / name)
    if rng.random() < 0.03:
        (folder / name).rename(
            folder / f"{Path(name).stem}{pick(rng, ['.mat', '.csv', '.h5', '.nc', '.wav'])}"
        )
        name = next(path.name for path in folder.iterdir() if path.suffix != ".toml")
    return ["fit", name, "--json"] if rng.random() < 0.2 else ["import", name, "o.nc"]
