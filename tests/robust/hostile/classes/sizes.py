"""Sound data and devices of a size that nothing was made for."""

from pathlib import Path

import numpy as np

from tests.robust.hostile.files import FILM, drum, measurement, pick


def _response(rng: np.random.Generator, folder: Path) -> list[str]:
    points = int(pick(rng, [100_000, 1_000_000]))
    sweeps = int(pick(rng, [1, 1, 20]))
    frequency = np.linspace(1e6, 1.001e6, points // sweeps)
    volts = 1e-3 * 20 / (frequency - 1.0005e6 + 20j) + 1e-5 * rng.normal(size=frequency.size)
    data = {
        "frequency": np.tile(frequency, (sweeps, 1)),
        "real": np.tile(volts.real, (sweeps, 1)),
        "imag": np.tile(volts.imag, (sweeps, 1)),
    }
    measurement(folder / "f.nc", "response", data)
    options = [
        ["show"],
        ["fit"],
        ["fit", "--as", "overview"],
        ["fit", "--modes", "3"],
        ["diagnose"],
    ]
    return _asked(options, rng)


def _asked(options: list[list[str]], rng: np.random.Generator) -> list[str]:
    command, *rest = pick(rng, options)
    extra = ["--workers", "1"] if command == "diagnose" else []
    return [command, "f.nc", *rest, *extra]


def _series(rng: np.random.Generator, folder: Path) -> list[str]:
    points = int(pick(rng, [20_000, 1_000_000]))
    pressure = np.linspace(1, 100, points)
    quality = 1e5 / (1 + pressure / 30) * (1 + 0.01 * rng.normal(size=points))
    measurement(folder / "f.nc", "series", {"pressure": pressure, "quality_factor": quality})
    return _asked([["show"], ["fit"], ["fit", "--law", "power"], ["diagnose"]], rng)


def _spectrum(rng: np.random.Generator, folder: Path) -> list[str]:
    lines = int(pick(rng, [300, 3_000]))
    frequency = 3.4e6 * np.sqrt(np.arange(1, lines + 1))
    data = {"frequency": frequency, "frequency_sd": np.full(lines, 10.0)}
    measurement(folder / "f.nc", "spectrum", data, {}, {"geometry": drum(folder)})
    return _asked([["show"], ["fit"], ["diagnose"]], rng)


def _map(rng: np.random.Generator, folder: Path) -> list[str]:
    side = int(pick(rng, [300, 1_500]))
    place = np.linspace(-5e-5, 5e-5, side)
    shape = np.exp(-(place[:, None] ** 2 + place**2) / 1e-9)
    real = np.stack([shape, shape**2]) + 1e-3 * rng.normal(size=(2, side, side))
    data = {"x": place, "y": place, "harmonic": [1, 2], "real": real, "imag": 0 * real}
    root = {"geometry": drum(folder)}
    measurement(folder / "f.nc", "map", data, {"wavelength": 632.8e-9}, root)
    return _asked([["show"], ["fit"], ["fit", "--fringe", "free"], ["diagnose"]], rng)


def _trace(rng: np.random.Generator, folder: Path) -> list[str]:
    samples = int(pick(rng, [400_000, 4_000_000]))
    steps = int(pick(rng, [1, 1, 40]))
    time = np.arange(samples // steps) * 2e-8
    volts = np.sin(2 * np.pi * 1e6 * time) * np.exp(-time / 1e-2)
    noisy = volts + 0.01 * rng.normal(size=(steps, time.size))
    data = {"time": time, "voltage": noisy, "drive_frequency": np.full(steps, 1e6)}
    root = {"geometry": drum(folder)}
    measurement(folder / "f.nc", "trace", data, {"wavelength": 632.8e-9}, root)
    options = [["fit", "--as", way] for way in ("ring-down", "envelope", "oscillator")]
    return _asked([["show"], ["fit"], ["diagnose"], *options], rng)


def _decay(rng: np.random.Generator, folder: Path) -> list[str]:
    points = int(pick(rng, [50_000, 1_000_000]))
    time = np.linspace(0, 100, points)
    power = np.logaddexp(-40 - 2 * time, -110) + rng.normal(size=points)
    measurement(folder / "f.nc", "decay", {"time": time, "power": power}, {"frequency": 1e6})
    return _asked([["show"], ["fit"], ["diagnose"]], rng)


def _device(rng: np.random.Generator, folder: Path) -> list[str]:
    way = int(rng.integers(6))
    square = 'kind = "square"\nside = "1 mm"'
    outline = 'kind = "circle"\ndiameter = "100 um"'
    if way == 0:
        corners = int(pick(rng, [200, 1_000, 20_000]))
        angle = 2 * np.pi * np.arange(corners) / corners
        radius = 50 * (1 + 0.05 * rng.random(corners))
        corner = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
        points = ", ".join(f'["{x:.6f} um", "{y:.6f} um"]' for x, y in corner)
        text = FILM.replace(outline, f'kind = "polygon"\npoints = [{points}]')
    elif way == 1:
        count = int(pick(rng, [2_000, 20_000]))
        grid = np.stack(np.meshgrid(np.arange(142), np.arange(142)), -1).reshape(-1, 2)[:count]
        places = 6.8 * (grid - 70.5) + rng.uniform(-1, 1, size=(len(grid), 2))
        centres = ", ".join(f'["{x:.4f} um", "{y:.4f} um"]' for x, y in places)
        holes = f'[holes]\nlattice = "list"\ncentres = [{centres}]\nradius = "1 um"\n'
        text = FILM.replace(outline, square) + holes
    elif way == 2:
        n = int(pick(rng, [100, 316]))
        holes = f'[holes]\nlattice = "square"\npitch = "{990 / n} um"\ncount = [{n}, {n}]\n'
        text = FILM.replace(outline, square) + holes + 'radius = "1 um"\n'
    elif way == 3:
        height = pick(rng, ["1 um", "0.1 um", "10 um"])
        text = FILM.replace(outline, f'kind = "rectangle"\nwidth = "1 mm"\nheight = "{height}"')
    elif way == 4:
        return _sweep(rng, folder)
    else:
        drum(folder)
        return ["modes", "drum.toml", "-n", str(pick(rng, [300, 3_000, 100_000]))]
    drum(folder, text)
    commands = [
        ["modes", "drum.toml", "-n", "2"],
        ["modes", "drum.toml", "-n", "2", "--homogenised"],
        ["mesh", "drum.toml"],
        ["view", "drum.toml", "mesh", "--out", "o.png"],
    ]
    return list(pick(rng, commands))


def _sweep(rng: np.random.Generator, folder: Path) -> list[str]:
    drum(folder)
    points = int(pick(rng, [1_000, 1_000_000]))
    axis = f'film.stress = {{ from = "1 GPa", to = "2 GPa", points = {points} }}'
    text = f'geometry = "drum.toml"\nmodes = 2\nresolution = 0.3\n[[axis]]\n{axis}\n'
    (folder / "s.toml").write_text(text, encoding="utf-8")
    return ["sweep", "s.toml", "--workers", "1", "--estimate"]


def make(rng: np.random.Generator, folder: Path) -> list[str]:
    """Write something of vast size, and ask a command for it."""
    makers = [_response, _series, _spectrum, _map, _trace, _decay, _device, _device, _device]
    return makers[int(rng.integers(len(makers)))](rng, folder)
