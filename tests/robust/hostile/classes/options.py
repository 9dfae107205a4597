"""Options of devices that no one can mean, layers, folders of effects, and the cache."""

import sys
from pathlib import Path

import numpy as np

from tests.robust.hostile.classes.texts import word
from tests.robust.hostile.files import FILM, drum, measurement, pick

FREQUENCIES = [
    "4.2 MHz",
    "0 Hz",
    "-1 MHz",
    "1 Hz",
    "1 GHz",
    "1 THz",
    "1e300 Hz",
    "nan Hz",
    "5 kg",
    "MHz",
    "",
]
PRESSURES = ["1e-6 mbar", "0 Pa", "-1 Pa", "1e300 Pa", "1e5 Pa", "1 m", "nan Pa", "x", ""]
NOISES = ["3 mV", "0 V", "-1 V", "1e300 V", "nan V", "1 m", "1e-300 V", "x", ""]
EFFECTS = [
    "",
    "EFFECT = 1\n",
    "import nowhere\n",
    "raise SystemExit(3)\n",
    "x = (\n",
    "EFFECT = EFFECT\n",
    "\0",
    "import os\nos.chdir('/')\nEFFECT = None\n",
    "raise ValueError('[/b]\\x1b[31m' + 'w' * 100000)\n",
    "raise RecursionError\n",
    "print('noise')\nEFFECT = []\n",
    "def f():\n    f()\nf()\n",
]
LIMITS = ["1", "0", "-1", "nan", "inf", "x", "", "1e400", "1e-9", "٣"]


def _layer(rng: np.random.Generator, number: int) -> str:
    """Return a table of a layer, of odd values now and then."""
    usual = rng.random() < 0.7
    thickness = "30 nm" if usual else pick(rng, ["30 nm", "1 pm", "1 um", "1 m", "0 nm"])
    lines = [
        "[[layers]]",
        f'name = "{pick(rng, ["metal", *[f"l{number}"] * 20])}"',
        f'thickness = "{thickness}"',
        f'young = "{"70 GPa" if usual else pick(rng, ["70 GPa", "1 Pa", "10 TPa"])}"',
        "poisson = 0.34",
        f'density = "{pick(rng, ["2700 kg/m^3", "1e6 kg/m^3"])}"',
        f'stress = "{"50 MPa" if usual else pick(rng, ["0 Pa", "-5 GPa", "-1 TPa", "10 GPa"])}"',
    ]
    if rng.random() < 0.3:
        lines.append(f'side = "{pick(rng, ["bottom"] * 8 + ["left"])}"')
    if rng.random() < 0.5:
        lines.append(f"quality_factor = {pick(rng, ['200'] * 6 + ['1', '0', '1e300', 'nan'])}")
    shapes = [
        'shape = {kind = "circle", diameter = "40 um"}',
        'shape = {kind = "circle", diameter = "1 m"}',
        'shape = {kind = "square", side = "1 pm"}',
        'shape = {kind = "square", side = "70.71 um"}',
        'shape = {kind = "polygon", points = [["60 um", "60 um"], ["70 um", "60 um"], '
        '["60 um", "70 um"]]}',
    ]
    if rng.random() < 0.4:
        lines.append(str(pick(rng, shapes)))
    return "\n".join(lines)


def layered(rng: np.random.Generator) -> str:
    """Return the drum with layers and a table of losses."""
    layers = "\n".join(_layer(rng, k) for k in range(int(pick(rng, [0, 1, 1, 1, 2, 40]))))
    loss = pick(
        rng,
        [
            *[""] * 8,
            "[loss]\nvolume = 30000\n",
            '[loss]\nvolume = 0\nsurface = "1 m"\n',
            '[loss]\nsurface = "1e-300 m^-1"\n',
            '[loss]\nsurface = "7e10 m^-1"\nsurface_error = "8e10 m^-1"\n',
        ],
    )
    return FILM.replace("[readout]", f"{layers}\n{loss}[readout]")


def _modes(rng: np.random.Generator, folder: Path) -> list[str]:
    drum(folder, layered(rng))
    words = ["modes", "drum.toml", "-n", str(pick(rng, ["1", "2", "4"])), "--resolution", "0.3"]
    ways = [
        ["--near", str(pick(rng, FREQUENCIES))],
        ["--near", str(pick(rng, FREQUENCIES)), "--q", "--bow", "layers"],
        ["--bow", "layers"],
        ["--bow", "layers", "--q", "--dilution"],
        ["--q"],
        ["--q", "--pressure", str(pick(rng, PRESSURES))],
        ["--pressure", str(pick(rng, PRESSURES))],
        ["--near", "4.2 MHz", "--tensor", "--inertia"],
        ["--bow", word(rng).replace("\0", "")[:2_000]],
        ["--edge", "paper", "--bow", "layers"],
    ]
    return [*words, *pick(rng, ways), *pick(rng, [[], ["--json"], ["--out", "o.nc"]])]


def _device(rng: np.random.Generator, folder: Path) -> list[str]:
    """Ask other commands for a drum with layers."""
    drum(folder, layered(rng))
    noise = str(pick(rng, NOISES))
    seed = str(pick(rng, ["1", "0", "-1", "99999999999999999999", "x"]))
    words = [
        ["maps", "drum.toml", "--z", "1", "--points", "5", f"--noise={noise}", f"--seed={seed}"],
        ["mesh", "drum.toml", "--resolution", "0.3"],
        ["bands", "drum.toml", "--resolution", "0.3"],
        ["view", "drum.toml", "thickness", "--resolution", "0.3", "--out", "o.png"],
        ["view", "drum.toml", "stress", "--resolution", "0.3", "--out", "o.png"],
        ["geometry", "check", "drum.toml", "--out", "o.png"],
        ["report", "drum.toml", "--out", str(pick(rng, ["o", "drum.toml", "/dev/null/x"]))],
    ]
    weights = np.array([3, 1, 1, 1, 1, 1, 0.3])
    return words[int(rng.choice(len(words), p=weights / weights.sum()))]


def _effects(rng: np.random.Generator, folder: Path) -> list[str]:
    """Name a folder of effects that are none."""
    own = folder / "own"
    own.mkdir()
    for number in range(int(pick(rng, [0, 1, 2]))):
        (own / f"e{number}.py").write_text(str(pick(rng, EFFECTS)), encoding="utf-8")
    if rng.random() < 0.2:
        (own / "link.py").symlink_to(pick(rng, ["/dev/zero", "link.py", "none"]))
    pressure = np.linspace(1, 100, 12)
    data = {"pressure": pressure, "quality_factor": 1e5 / (1 + pressure / 30)}
    measurement(folder / "f.nc", "series", data)
    place = str(pick(rng, ["own", "own", "own", "none", "f.nc", ""]))
    words = [["effects"], ["diagnose", "f.nc", "--workers", "1"], ["effects", "e0"]]
    return [*pick(rng, words), "--effects", place]


def _cache(rng: np.random.Generator, folder: Path) -> list[str]:
    """Put something odd in the place of the cache, and show, clear or use it."""
    kept = folder / "cache" / "femnl"
    way = int(rng.integers(6))
    if way == 0:
        kept.parent.mkdir()
        kept.write_text("in the way")
    elif way == 1:
        kept.parent.mkdir()
        kept.symlink_to("femnl")
    elif way == 2:
        kept.mkdir(parents=True)
        for name in ("modes-x.nc", "nonlinearity-x.npz", "other", "a\x1b[31m.nc"):
            (kept / name).write_bytes(rng.bytes(50))
        (kept / "modes-y.nc").mkdir()
        (kept / "modes-z.nc").symlink_to("/nowhere")
    elif way == 3:
        kept.mkdir(parents=True)
        kept.chmod(0o500)
    drum(folder)
    solve = "modes drum.toml -n 1 --resolution 0.3"
    command = pick(rng, ["cache show", "cache show --json", "cache clear", "cache", solve, solve])
    given = f"XDG_CACHE_HOME=$PWD/cache FEMNL_CACHE_GIB='{pick(rng, LIMITS)}'"
    return ["!", f"{given} {sys.executable} -m femnl {command}"]


def make(rng: np.random.Generator, folder: Path) -> list[str]:
    """Ask for something odd by the options of a command."""
    makers = [_modes, _modes, _modes, _device, _device, _effects, _cache]
    return makers[int(rng.integers(len(makers)))](rng, folder)
