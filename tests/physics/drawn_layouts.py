"""Shapes of layouts drawn by a seed.

Slits and slots, holes near edges, fillets, ellipses and rounded holes, strips ten times as long as
wide, webs, trampolines, splines, unions and differences.
"""

import numpy as np

Drawn = tuple[str, str]  # the tables of an outline and of the holes

SQUARE = 'kind = "square"\nside = "1 m"'


def pair(x: float, y: float) -> str:
    """Return a point of a file."""
    return f'["{round(x, 9)} m", "{round(y, 9)} m"]'


def listed(points: list[tuple[float, float]]) -> str:
    """Return a list of points of a file."""
    return f"[{', '.join(pair(x, y) for x, y in points)}]"


def opening(x: float, y: float, shape: str, angle: float = 0.0) -> str:
    """Return the table of one free hole of any shape, turned by an angle in degrees."""
    return (
        f'[[holes]]\nlattice = "list"\ncentres = [{pair(x, y)}]\nshape = {{{shape}}}\n'
        f'angle = "{angle:.4g} deg"\n'
    )


def rounded(width: float, height: float, fillet: float) -> str:
    """Return a rectangle whose corners are arcs."""
    return (
        f'kind = "rectangle", width = "{width:.12g} m", height = "{height:.12g} m", '
        f'fillet = "{fillet:.12g} m"'
    )


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """Return a number whose logarithm is drawn evenly."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _slit(rng: np.random.Generator) -> Drawn:
    """Return a free slit with round ends, 7 to 100 times as long as wide."""
    length = float(rng.uniform(0.15, 0.4))
    width = length * log_uniform(rng, 0.01, 0.15)
    x, y = (float(v) for v in rng.uniform(-0.2, 0.2, 2))
    angle = float(rng.choice([0, 45, float(rng.uniform(0, 180))]))
    return SQUARE, opening(x, y, rounded(length, width, width / 2), angle)


def _near_edge(rng: np.random.Generator) -> Drawn:
    """Return a disc with up to three small holes that the edge is 0.3 to 3 radii away from."""
    holes = ""
    for turn in rng.choice(8, int(rng.integers(1, 4)), replace=False):
        radius = log_uniform(rng, 0.003, 0.03)
        away = 0.5 - radius * (1 + float(rng.uniform(0.3, 3)))
        x, y = away * np.cos(turn * np.pi / 4), away * np.sin(turn * np.pi / 4)
        holes += f'[[holes]]\nlattice = "list"\ncentres = [{pair(x, y)}]\n'
        holes += f'radius = "{radius:.6g} m"\n'
    return 'kind = "circle"\ndiameter = "1 m"', holes


def _fillets(rng: np.random.Generator) -> Drawn:
    """Return an L with fillets at some of its corners."""
    arm, leg = (float(v) for v in rng.uniform(0.3, 0.6, 2))
    corners = [(0.0, 0.0), (1.0, 0.0), (1.0, arm), (leg, arm), (leg, 1.0), (0.0, 1.0)]
    radii = [log_uniform(rng, 0.01, 0.14) if rng.random() < 0.6 else 0.0 for _ in corners]
    fillets = ", ".join(f'"{radius:.6g} m"' for radius in radii)
    return f'kind = "polygon"\npoints = {listed(corners)}\nfillet = [{fillets}]', ""


def _rounded_holes(rng: np.random.Generator) -> Drawn:
    """Return an ellipse, a rounded rectangle and a rounded polygon in one square."""
    a = float(rng.uniform(0.05, 0.12))
    b = a * float(rng.uniform(0.2, 0.9))
    turns = [float(turn) for turn in rng.uniform(0, 180, 3)]
    ellipse = (
        f'[[holes]]\nlattice = "list"\ncentres = [{pair(-0.22, 0.2)}]\n'
        f'semi_axes = ["{a:.6g} m", "{b:.6g} m"]\nangle = "{turns[0]:.4g} deg"\n'
    )
    box = opening(0.2, 0.22, rounded(1.6 * a, 1.2 * b, 0.3 * b), turns[1])
    sides = int(rng.integers(3, 8))
    polygon = (
        f'kind = "regular-polygon", sides = {sides}, long_axis = "{1.8 * a:.6g} m", '
        f'fillet = "{0.2 * a:.6g} m"'
    )
    return SQUARE, ellipse + box + opening(0.05, -0.2, polygon, turns[2])


def _slots(rng: np.random.Generator) -> Drawn:
    """Return a row of slots across a rectangle."""
    count = int(rng.integers(2, 6))
    pitch = 0.9 / count
    width = pitch * float(rng.uniform(0.1, 0.6))
    height = float(rng.uniform(0.2, 0.6))
    holes = (
        f'[[holes]]\nlattice = "rectangular"\npitch = {pair(pitch, 1)}\ncount = [{count}, 1]\n'
        f"shape = {{{rounded(width, height, min(width, height) / 2)}}}\n"
    )
    return 'kind = "rectangle"\nwidth = "1 m"\nheight = "0.8 m"', holes


def _slender(rng: np.random.Generator) -> Drawn:
    """Return a strip ten times as long as wide: clamped all around, or at its ends alone."""
    kind = int(rng.integers(4))
    if kind == 0:
        return 'kind = "ellipse"\nwidth = "1 m"\nheight = "0.1 m"', ""
    if kind == 1:
        fillet = float(rng.uniform(0.005, 0.05))
        return (
            f'kind = "rectangle"\nwidth = "1 m"\nheight = "0.1 m"\nfillet = "{fillet:.4g} m"',
            "",
        )
    corners = [(-0.5, -0.05), (0.5, -0.05), (0.5, 0.05), (-0.5, 0.05)]
    radius = log_uniform(rng, 0.005, 0.03)
    hole = opening(float(rng.uniform(-0.3, 0.3)), 0.0, rounded(4 * radius, 2 * radius, radius))
    free = f'kind = "polygon"\npoints = {listed(corners)}\nfree = [1, 3]'
    return free, hole if kind == 3 else ""


def _web(rng: np.random.Generator) -> Drawn:
    tether = float(rng.uniform(0.01, 0.03))
    beams = sorted(float(at) for at in rng.uniform(0.2, 0.4, int(rng.integers(1, 3))))
    if len(beams) == 2 and beams[1] - beams[0] < 0.06:
        beams = beams[:1]
    distances = ", ".join(f'"{at:.4g} m"' for at in beams)
    return (
        f'kind = "web"\nspan = "1 m"\ntether = "{tether:.4g} m"\n'
        f'pad = "{rng.uniform(0.12, 0.2):.4g} m"\ntethers = {rng.integers(4, 7)}\n'
        f'beams = [{distances}]\nbeam = "{tether * rng.uniform(0.5, 1):.4g} m"\n'
        f'fillet = "{tether * rng.uniform(0.5, 1):.4g} m"',
        "",
    )


def _trampoline(rng: np.random.Generator) -> Drawn:
    tether = log_uniform(rng, 0.01, 0.05)
    pad = float(rng.uniform(0.2, 0.4))
    fillet = min(tether * float(rng.uniform(1, 3)), 0.2 * (pad - tether))
    radius = pad * float(rng.uniform(0.02, 0.15))
    hole = f'[[holes]]\nlattice = "list"\ncentres = [{pair(0, 0)}]\nradius = "{radius:.6g} m"\n'
    return (
        f'kind = "trampoline"\nspan = "1 m"\ntether = "{tether:.4g} m"\npad = "{pad:.4g} m"\n'
        f'fillet = "{fillet:.4g} m"',
        hole if rng.random() < 0.5 else "",
    )


def _spline(rng: np.random.Generator) -> Drawn:
    """Return a smooth star-like curve through points at random distances."""
    count = int(rng.integers(5, 12))
    angles = 2 * np.pi * np.arange(count) / count
    radii = rng.uniform(0.35, 0.5, count)
    points = [
        (float(r * np.cos(a)), float(r * np.sin(a))) for r, a in zip(radii, angles, strict=True)
    ]
    return f'kind = "spline"\npoints = {listed(points)}', ""


def _union(rng: np.random.Generator) -> Drawn:
    """Return a disc and a bar across it, added."""
    bar = f'kind = "rectangle", width = "1 m", height = "{rng.uniform(0.1, 0.3):.4g} m"'
    fillet = "0" if rng.random() < 0.5 else f"{rng.uniform(0.005, 0.04):.4g}"
    second = f"{{shape = {{{bar}}}, angle = '{rng.uniform(50, 90):.4g} deg'}}"
    diameter = f'kind = "circle", diameter = "{rng.uniform(0.5, 0.8):.4g} m"'
    parts = f"[{{shape = {{{diameter}}}}}, {{shape = {{{bar}}}}}, {second}]"
    return f'kind = "combined"\nparts = {parts}\nfillet = "{fillet} m"', ""


def _difference(rng: np.random.Generator) -> Drawn:
    """Return a square without an ellipse that bites into its side, clamped or free."""
    wide, high = (float(v) for v in rng.uniform(0.2, 0.6, 2))
    x = float(rng.choice([0.0, float(rng.uniform(-0.15, 0.15))]))
    bite = f'kind = "ellipse", width = "{wide:.4g} m", height = "{high:.4g} m"'
    cut = f'name = "bite", operation = "subtract", shape = {{{bite}}}, at = {pair(x, 0.5)}'
    free = "\nfree = ['bite']" if rng.random() < 0.5 else ""
    shape = 'shape = {kind = "square", side = "1 m"}'
    return f'kind = "combined"{free}\nparts = [{{{shape}}}, {{{cut}}}]', ""


LAYOUTS = (
    _slit,
    _near_edge,
    _fillets,
    _rounded_holes,
    _slots,
    _slender,
    _web,
    _trampoline,
    _spline,
    _union,
    _difference,
)
