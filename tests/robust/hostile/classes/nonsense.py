"""Devices, sweeps and options that no laboratory can mean."""

from pathlib import Path

import numpy as np

from tests.robust.hostile.files import drum, pick

LENGTHS = ["1 m", "1 km", "1 pm", "1 nm", "10 um", "100 um", "1 mm", "270 um", "99 um"]
PRESSURES = ["1 Pa", "10 TPa", "1 MPa", "1 GPa", "250 GPa", "1 kPa"]
NUMBERS = [
    "0",
    "-1",
    "1e-300",
    "1e300",
    "nan",
    "inf",
    "-inf",
    "1e400",
    "0.5",
    "3",
    "1e9",
    "-1e12",
    "x",
]
OUTLINES = [
    'kind = "circle"\ndiameter = "{a}"',
    'kind = "square"\nside = "{a}"',
    'kind = "rectangle"\nwidth = "{a}"\nheight = "{b}"',
    'kind = "ellipse"\nwidth = "{a}"\nheight = "{b}"',
    'kind = "square"\nside = "{a}"\nfillet = "{b}"',
    'kind = "polygon"\npoints = [["0 um", "0 um"], ["{a}", "0 um"], ["{b}", "{a}"]]',
    'kind = "polygon"\npoints = [["{a}", "{a}"], ["{b}", "{a}"], ["{b}", "{b}"], ["{a}", "{b}"]]',
    'kind = "regular-polygon"\nsides = {n}\nlong_axis = "{a}"',
]
EXTRA = [
    "",
    "",
    '[clamp]\nnormal = "{p}"\ndraw = "{a}"\n',
    '[clamp]\ndeflection = "{p}"\nrotation = "1 N"\n',
    '[overhang]\nwidth = "{a}"\n',
    '[overhang]\nwidth = "1 um"\nstress = "{p}"\nthickness = "{b}"\n',
    '[holes]\nlattice = "list"\ncentres = [["{a}", "{b}"]]\nradius = "1 um"\n',
    '[holes]\nlattice = "square"\npitch = "{a}"\ncount = [{n}, {n}]\nradius = "{b}"\n',
    '[readout]\ngap = "{a}"\n',
    '[[holes]]\nlattice = "list"\ncentres = [["0 um", "0 um"]]\nsemi_axes = ["{a}", "{b}"]\n',
]


def _filled(rng: np.random.Generator, text: str) -> str:
    for mark, values in (
        ("a", LENGTHS),
        ("b", LENGTHS),
        ("p", PRESSURES),
        ("n", ["3", "30", "1", "0"]),
    ):
        text = text.replace(f"{{{mark}}}", str(pick(rng, values)))
    return text


def device(rng: np.random.Generator) -> str:
    """Return the geometry of a device of odd proportions."""
    outline = _filled(rng, pick(rng, OUTLINES))
    usual = rng.random() < 0.3
    thickness = "100 nm" if usual else pick(rng, LENGTHS)
    stress = "1 GPa" if usual else pick(rng, PRESSURES)
    film = [
        f'thickness = "{thickness}"',
        f'young = "{pick(rng, PRESSURES) if rng.random() < 0.3 else "250 GPa"}"',
        f"poisson = {pick(rng, ['0.23', '0.0', '0.4999999999', '0.5'])}",
        f'density = "{pick(rng, ["3100 kg/m^3", "3100 kg/m^3", "1e-3 kg/m^3", "1e6 kg/m^3"])}"',
        f'stress = "{stress}"',
    ]
    if rng.random() < 0.15:
        film.append(f'gradient = ["{pick(rng, ["1 nm/um", "0.1 m/m"])}", "0 nm/um"]')
    if rng.random() < 0.1:
        film.append(f'taper = "{pick(rng, LENGTHS)}"\ntaper_length = "{pick(rng, LENGTHS)}"')
    lines = [f'name = "odd"\n[outline]\n{outline}\n[film]', *film, _filled(rng, pick(rng, EXTRA))]
    return "\n".join(lines)


def _of_device(rng: np.random.Generator, name: str) -> list[str]:
    number = str(pick(rng, NUMBERS))
    length = str(pick(rng, LENGTHS))
    return pick(
        rng,
        [
            ["modes", name, "--resolution", "0.3", "-n", "2"],
            ["modes", name, "--resolution", "0.3", "-n", "2"],
            ["modes", name, "--resolution", "0.3", "-n", "2", "--dilution"],
            ["modes", name, "--resolution", "0.3", "-n", "2", "--inertia"],
            ["modes", name, "--resolution", "0.3", "-n", "2", "--homogenised"],
            ["modes", name, "--resolution", number],
            ["modes", name, "--resolution", "0.3", "--bow", f"{number} Pa"],
            ["modes", name, "--resolution", "0.3", "-n", "1", "--bow", length],
            ["modes", name, "--resolution", "0.3", "-n", "1", "--tolerance", number],
            ["mesh", name, "--resolution", "0.3"],
            ["bands", name, "--resolution", "0.3", "--steps", "2"],
            ["maps", name, f"--z={number}", "--points", "5"],
            ["maps", name, "--z", "1", f"--theta={number}", "--points", "5"],
            ["maps", name, "--z", "1", "--wavelength", length, "--points", "5"],
            ["maps", name, "--z", "1", "--fringe", "multilayer", "--points", "5"],
            ["view", name, "mesh", "--out", "o.png", "--resolution", "0.3"],
            [
                "view",
                name,
                "shape",
                "--mode",
                str(pick(rng, ["1", "0", "-1", "99"])),
                "--out",
                "o.png",
            ],
        ],
    )


def _sweep(rng: np.random.Generator, folder: Path, name: str) -> list[str]:
    axis = pick(
        rng,
        [
            'film.stress = ["1 GPa", 1, true]',
            'film = [{ stress = "1 GPa" }]',
            'outline.kind = ["square", "circle"]',
            'outline.diameter = { from = "1 nm", to = "1 km", points = 3 }',
            "film.poisson = { from = -1, to = 1, points = 3 }",
            'film.thickness = { from = "1 m", to = "1 pm", points = 2, spacing = "log" }',
            "model.bending = [true, false, 3]",
            'film.stress = { from = "1 GPa", to = "1e999 GPa", points = 2 }',
            "film.poisson = [[0.1], {}]",
            'name = ["a", "b"]',
            'film.stress.x = ["1 GPa"]',
            'film.stress = { from = "1 GPa", to = "1 GPa", points = 1000001 }',
        ],
    )
    head = pick(
        rng,
        [
            "",
            "modes = 0\n",
            "modes = 1000\n",
            "resolution = 1e9\n",
            "keep = []\n",
            'keep = ["x"]\n',
        ],
    )
    sample = pick(rng, ["", "", "[sample]\npoints = 3\n", "[sample]\npoints = 0\n"])
    text = f'geometry = "{name}"\n{head}{sample}[[axis]]\n{axis}\n'
    (folder / "s.toml").write_text(text, encoding="utf-8")
    return ["sweep", "s.toml", "--workers", "1", *pick(rng, [[], ["--estimate"]])]


def make(rng: np.random.Generator, folder: Path) -> list[str]:
    """Ask for something that nobody can mean."""
    name = drum(folder) if rng.random() < 0.3 else drum(folder, device(rng))
    if rng.random() < 0.12:
        return _sweep(rng, folder, name)
    return _of_device(rng, name)
