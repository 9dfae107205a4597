"""Studies of chips, and tables of devices, that were written in a hurry or by no one."""

from pathlib import Path

import numpy as np

from tests.robust.hostile.classes.texts import in_quotes, word
from tests.robust.hostile.files import drum, measurement, pick, resonance

NUMBERS = ["1.02 MHz", "1.0e6", "0 Hz", "-1 MHz", "1e300 Hz", "1e-300 Hz", "nan Hz", "5 kg", "x"]
PLACES = ["0 mm", "2 mm", "-1 km", "1e300 m", "3", "nan mm"]
PATTERNS = [
    "(?P<y>[0-9])(?P<x>[0-9])",
    "(?P<x>.)(?P<y>.)?",
    "(a+)+$(?P<x>)(?P<y>)",
    "(?P<x>(x+x+)+y)(?P<y>)",
    "(",
    "",
    "(?P<x>.*)(?P<y>.*)",
]


def _device(rng: np.random.Generator, number: int, design: str) -> str:
    usual = rng.random() < 0.85
    frequency = f"{1.02 + 1e-3 * rng.normal():.6f} MHz" if usual else pick(rng, NUMBERS)
    name = f"A{number}" if rng.random() < 0.97 else word(rng).replace("\0", "")
    lines = ["[[device]]", f"name = {in_quotes(name)}"]
    if design:
        lines.append(f'design = "{design}"')
    if rng.random() < 0.8:
        x, y = (f"{number % k} mm" if rng.random() < 0.95 else pick(rng, PLACES) for k in (3, 4))
        lines.append(f'position = ["{x}", "{y}"]')
    if rng.random() < 0.05:
        lines.append(f'measurement = "{pick(rng, ["f.nc", "none.nc", ".", "drum.toml", ""])}"')
    quality = "1e6" if usual else pick(rng, ["1.2e6", "0.2e6", "1e300", "0", "nan", "-1"])
    values = f'frequency = "{frequency}", frequency_sd = "5 Hz", quality_factor = {quality}'
    modes = [f'{{ mode = "1", {values} }}']
    if rng.random() < 0.3:
        modes = [*modes, *(m.replace('"1"', f'"{k}"') for m in modes for k in (2, 3))]
    lines.append(f"modes = [{', '.join(modes)}]")
    return "\n".join(lines)


def _devices(rng: np.random.Generator, folder: Path) -> str:
    """Devices one by one, some with a geometry."""
    design = pick(rng, ["", "small", "small"])
    count = int(pick(rng, [1, 4, 6, 6, 12, 30]))
    text = "\n".join(_device(rng, number, design) for number in range(count))
    if design and rng.random() < 0.7:
        geometry = pick(rng, [drum(folder), "circle", "none", "", "f.nc", "../../x"])
        text += f'\n[design.{design}]\ngeometry = "{geometry}"'
    return text


def _table(rng: np.random.Generator, folder: Path) -> str:
    """A table of numbers with odd rows."""
    rows = ["sample,frequency_Hz,quality_factor"]
    for number in range(int(pick(rng, [0, 3, 12, 40, 3_000]))):
        row = [f"P-{number // 6}{number % 6}", f"{1e6 * (1 + 1e-3 * rng.normal()):.1f}", "1e6"]
        if rng.random() < 0.03:
            row[int(rng.integers(3))] = pick(rng, ["", "nan", "x", "1e400", "-1", "1,2", '"', "0"])
        rows.append(",".join(row))
    content = "\n".join(rows).encode()
    if rng.random() < 0.15:
        content = content.replace(b"P", pick(rng, [b"\xff", b"\0", b"\x1b[31m", b'"']), 1)
    (folder / "t.csv").write_bytes(content)
    columns = 'device = "sample"\nfrequency = "frequency_Hz"\n'
    if rng.random() < 0.1:
        columns = columns.replace("sample", pick(rng, ["", "none", "frequency_Hz"]))
    chip = pick(rng, ["", "P-", "Q"])
    file = pick(rng, ["t.csv", "t.csv", "t.csv", "none.csv", ".", "/dev/zero"])
    text = f'[table]\nfile = "{file}"\nchip = "{chip}"\n[table.columns]\n{columns}'
    if rng.random() < 0.6:
        pitch = pick(rng, ['"2 mm"', "1.0", '"x"', '"1e300 m"', "0.0", '"0 mm"', "-1.0"])
        text += f"[positions]\npattern = '{pick(rng, PATTERNS)}'\npitch = {pitch}\n"
    return text


def make(rng: np.random.Generator, folder: Path) -> list[str]:
    """Write a study, and fit its chip."""
    frequency, volts = resonance(rng)
    data = {"frequency": frequency[None], "real": volts.real[None], "imag": volts.imag[None]}
    measurement(folder / "f.nc", "response", data, {"noise_sd": 1e-6})
    body = _devices(rng, folder) if rng.random() < 0.6 else _table(rng, folder)
    (folder / "c.toml").write_text(f'name = "chip"\n{body}\n', encoding="utf-8")
    return ["chip", "c.toml", *pick(rng, [[], ["--json"], ["--out", "o"]])]
