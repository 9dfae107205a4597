"""Small files that ask for vast work: nested, linked, sparse, compressed, or endless."""

import os
import zlib
from pathlib import Path

import h5py
import numpy as np
from scipy.io import savemat

from tests.robust.hostile.files import FILM, drum, measurement, pick

SIZES = [1_000, 5_000, 20_000, 100_000]


def _toml_text(rng: np.random.Generator) -> str:
    n = int(pick(rng, SIZES))
    return str(
        pick(
            rng,
            [
                ".".join(["a"] * n) + " = 1\n",
                "x = " + "[" * n + "]" * n + "\n",
                "x = " + "{a=" * n + "1" + "}" * n + "\n",
                "".join(f"a{k}.b.c.d.e = {k}\n" for k in range(n)),
                "\n".join(f"[a.{'b.' * (k % 500)}c{k}]" for k in range(n // 10)) + "\n",
                "x = " + "1" * n + "\n",
                "x = 0x" + "f" * n + "\n",
                'x = "' + "\\u0041" * n + '"\n',
                'x = """' + "\n" * n + '"""\n',
                "\n" * n,
                "#" * n,
                'x = "' + "a" * n,
                f"[{'.'.join(['a'] * n)}]\n",
                "".join("[[holes]]\n" for _ in range(n)),
                "".join(f'"{"k" * 50}{k}" = 1\n' for k in range(n)),
                "x = " + "1_" * n + "1\n",
                "x = 1e" + "9" * n + "\n",
                "a" + ".a" * n,
            ],
        )
    )


def _toml(rng: np.random.Generator, folder: Path) -> list[str]:
    text = _toml_text(rng)
    if rng.random() < 0.3:
        text = FILM.replace('name = "drum"\n', f'name = "drum"\n{text}')
    (folder / "b.toml").write_text(text, encoding="utf-8")
    (folder / "t.csv").write_text("a,b\n1,2\n", encoding="utf-8")
    measurement(
        folder / "f.nc", "map", {"real": [1.0]}, {}, {"model": text[:60_000], "geometry": "b"}
    )
    commands = [
        ["modes", "b.toml"],
        ["mesh", "b.toml"],
        ["sweep", "b.toml"],
        ["chip", "b.toml"],
        ["import", "t.csv", "o.nc", "--spec", "b.toml"],
        ["show", "f.nc"],
    ]
    return list(pick(rng, commands))


def _json(rng: np.random.Generator, folder: Path) -> list[str]:
    n = int(pick(rng, SIZES))
    drum(folder)
    axis = 'geometry = "drum.toml"\n[[axis]]\nfilm.stress = ["1 GPa"]\n'
    (folder / "s.toml").write_text(axis, encoding="utf-8")
    text = pick(rng, ["[" * n, '{"a":' * n, "1" * n, '"' + "a" * n, '{"a":1,' * n, "-" * n])
    (folder / "s.jsonl").write_text(f"{text}\n", encoding="utf-8")
    return ["sweep", "s.toml", "--workers", "1", "--estimate"]


def _linked(group: h5py.Group) -> None:
    """2¹⁴ ways through hard links."""
    node = group
    for _ in range(14):
        inner = node.create_group("a")
        node["b"] = inner
        node = inner


def _looped(group: h5py.Group) -> None:
    group["loop"] = group


def _attributed(group: h5py.Group) -> None:
    for k in range(20_000):
        group.attrs[f"a{k}"] = k


def _many_groups(group: h5py.Group) -> None:
    for k in range(5_000):
        group.file.create_group(f"h{k}").attrs["kind"] = "map"


def _many_texts(group: h5py.Group) -> None:
    kind = h5py.string_dtype()
    group.create_dataset("label", data=["x" * 1_000] * 5_000, dtype=kind)


def _long_text(group: h5py.Group) -> None:
    group["label"] = "x" * 30_000_000


def _hollow(group: h5py.Group) -> None:
    group.create_dataset("real", (1, 20_000, 20_000), dtype="f8", chunks=(1, 500, 500))


def _long_attributes(group: h5py.Group) -> None:
    group.attrs["title"] = "x" * 60_000
    group.file.attrs["title"] = np.arange(8_000)


def _elsewhere(group: h5py.Group) -> None:
    group["soft"] = h5py.SoftLink("/nowhere")
    group["ext"] = h5py.ExternalLink("/etc/passwd", "/")


def _empty_and_vast(group: h5py.Group) -> None:
    group.create_dataset("real", (0, 2**62, 2**62), dtype="f8")


def _strays(group: h5py.Group) -> None:
    for k in range(3_000):
        group[f"stray{k}"] = [1.0]


def _zeros(group: h5py.Group) -> None:
    shape = (1, 4_000, 4_000)
    group.create_dataset("real", shape, dtype="f8", chunks=shape, compression="gzip")
    group["real"][:] = 0.0


HDF5 = [
    _linked,
    _looped,
    _attributed,
    _many_groups,
    _many_texts,
    _long_text,
    _hollow,
    _long_attributes,
    _elsewhere,
    _empty_and_vast,
    _strays,
    _zeros,
]


def _hdf5(rng: np.random.Generator, folder: Path) -> list[str]:
    path = folder / "b.nc"
    with h5py.File(path, "w") as file:
        file.attrs["femnl_measurement"] = "1.1"
        group = file.create_group("g")
        group.attrs["kind"] = "map"
        HDF5[int(rng.integers(len(HDF5)))](group)
    name = pick(rng, ["b.nc", "b.h5", "b.mat"])
    path.rename(folder / name)
    if name == "b.nc":
        return pick(rng, [["show", "b.nc"], ["fit", "b.nc"], ["diagnose", "b.nc"]])
    return ["import", name, "o.nc"]


def _special(rng: np.random.Generator, folder: Path) -> list[str]:
    """FIFOs, devices, sparse gigabytes and folders in the place of files."""
    suffix = pick(
        rng, [".nc", ".toml", ".csv", ".mat", ".h5", ".gsf", ".npy", ".wav", ".lvm", ".txt"]
    )
    path = folder / f"b{suffix}"
    way = int(rng.integers(5))
    if way == 0:
        os.mkfifo(path)
    elif way == 1:
        path.symlink_to(pick(rng, ["/dev/zero", "/dev/urandom", "/dev/null", "/dev/stdin"]))
    elif way == 2:
        start = {".nc": b"\x89HDF\r\n\x1a\n", ".h5": b"\x89HDF\r\n\x1a\n", ".npy": b"\x93NUMPY\1\0"}
        with path.open("wb") as file:
            file.write(start.get(suffix, b"a,b\n1,2\n"))
            file.truncate(int(pick(rng, [2**31, 2**40])))
    elif way == 3:
        path.mkdir()
    else:
        path.symlink_to(path.name)
    (folder / "t.csv").write_text("a,b\n1,2\n", encoding="utf-8")
    commands = [
        ["show", path.name],
        ["fit", path.name],
        ["fit", "."],
        ["diagnose", path.name],
        ["import", path.name, "o.nc"],
        ["import", ".", "o.nc"],
        ["modes", path.name],
        ["mesh", path.name],
        ["sweep", path.name],
        ["chip", path.name],
        ["import", "t.csv", "o.nc", "--spec", path.name],
    ]
    return list(pick(rng, commands))


def _lab(rng: np.random.Generator, folder: Path) -> list[str]:
    way = int(rng.integers(6))
    spec = 'kind = "trace"\n[columns]\ntime = "a"\nvoltage = "b"\n'
    (folder / "b.toml").write_text(spec, encoding="utf-8")
    if way == 0:
        savemat(
            folder / "b.mat", {"a": np.zeros(12_000_000), "b": np.zeros(3)}, do_compression=True
        )
        return ["import", "b.mat", "o.nc"]
    if way == 1:
        bomb = zlib.compress(b"\x0e\0\0\0" + b"\xff\xff\xff\x7f" + bytes(50_000_000))
        head = b"MATLAB 5.0 MAT-file".ljust(124) + b"\0\1IM"
        element = b"\x0f\0\0\0" + len(bomb).to_bytes(4, "little") + bomb
        (folder / "b.mat").write_bytes(head + element)
        return ["import", "b.mat", "o.nc"]
    if way == 2:
        (folder / "b.csv").write_text("a,b\n" + '"' + "x\n" * 500_000, encoding="utf-8")
        return ["import", "b.csv", "o.nc"]
    if way == 3:
        (folder / "b.csv").write_text(",".join("ab") + "\n" + "1," * 3_000_000, encoding="utf-8")
        return ["import", "b.csv", "o.nc"]
    if way == 4:
        deep = b"(" * 5_000
        head = b"\x93NUMPY\1\0" + len(deep).to_bytes(2, "little") + deep
        (folder / "b.npy").write_bytes(head)
        return ["import", "b.npy", "o.nc"]
    shape = b"{'descr': '<f8', 'fortran_order': False, 'shape': (2, 9000000000)}".ljust(117) + b"\n"
    (folder / "b.npy").write_bytes(b"\x93NUMPY\1\0" + len(shape).to_bytes(2, "little") + shape)
    return ["import", "b.npy", "o.nc"]


def make(rng: np.random.Generator, folder: Path) -> list[str]:
    """Write a bomb of some kind."""
    makers = [_toml, _toml, _json, _hdf5, _hdf5, _special, _special, _lab]
    return makers[int(rng.integers(len(makers)))](rng, folder)
