"""Draw the floors of femnl's packages and the flow of its values, from the code itself.

`python docs/architecture.py` writes docs/architecture.svg; the build of the site does, too.
"""

import ast
import runpy
from collections.abc import Iterator
from html import escape
from pathlib import Path

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "femnl"
TABLE = ROOT / "tests" / "test_floors.py"
PICTURE = Path(__file__).with_name("architecture.svg")
FLOW = (
    ("device/geometry/reader.py", "load"),
    ("device/mesh/build.py", "mesh"),
    ("mechanics/prestress.py", "solve_prestress"),
    ("pipeline.py", "solve_modes"),
    ("pipeline.py", "solve_nonlinearity"),
    ("pipeline.py", "harmonic_maps"),
)
"""Functions that make one value of the flow from the last."""
WIDTH = 960
HEIGHT = 34
GAP = 10


def floors() -> tuple[tuple[str, ...], ...]:
    """Return the table of floors, lowest first, from the test that enforces it."""
    found: tuple[tuple[str, ...], ...] = runpy.run_path(str(TABLE))["FLOORS"]
    return found


def imported(module: str) -> set[str]:
    """Return the dotted names below femnl that a module imports, its own left out."""
    place = PACKAGE / Path(*module.split("."))
    files = place.rglob("*.py") if place.is_dir() else [place.with_suffix(".py")]
    names = {name for file in files for name in _imports(file)}
    return {name for name in names if not f"{name}.".startswith(f"{module}.")}


def _imports(file: Path) -> Iterator[str]:
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("femnl."):
            yield (node.module or "").removeprefix("femnl.")


def returned(file: str, function: str) -> str:
    """Return the name of the type that a function of the package returns."""
    for node in ast.walk(ast.parse((PACKAGE / file).read_text(encoding="utf-8"))):
        if isinstance(node, ast.FunctionDef) and node.name == function and node.returns:
            return ast.unparse(node.returns)
    raise LookupError(f"femnl/{file}: has no function {function} with a type of what it returns")


def _box(x: float, y: float, width: float, text: str, hint: str, colour: str) -> str:
    return (
        f'<g><title>{escape(hint)}</title><rect x="{x:.1f}" y="{y:.1f}" width="{width:.1f}" '
        f'height="{HEIGHT}" rx="5" fill="{colour}" stroke="#345"/><text x="{x + width / 2:.1f}" '
        f'y="{y + 22:.1f}" text-anchor="middle">{escape(text)}</text></g>'
    )


def _row(names: list[str], hints: list[str], y: float, colour: str) -> tuple[list[str], float]:
    """Return boxes side by side from y on, in as many lines as they need, and the next y."""
    parts = []
    x = 0.0
    for name, hint in zip(names, hints, strict=True):
        width = 8.2 * len(name) + 18
        if x + width > WIDTH:
            x = 0.0
            y += HEIGHT + GAP
        parts.append(_box(x, y, width, name, hint, colour))
        x += width + GAP
    return parts, y + HEIGHT + GAP


def draw() -> str:
    """Return the picture as SVG: the flow on top, then the floors, highest first."""
    values = ["geometry file", *(returned(file, name) for file, name in FLOW)]
    makers = ["", *(f"{name} in femnl/{file}" for file, name in FLOW)]
    arrows = [f"{value} →" for value in values[:-1]] + values[-1:]
    parts, y = _row(arrows, makers, 0.0, "#fdf3dc")
    y += 2 * GAP
    roots = {name.split(".")[0] for floor in floors() for name in floor if "." in name}
    for modules in reversed(floors()):
        floor = [name for name in modules if name not in roots]  # a root holds its parts alone
        hints = [f"{name} imports {', '.join(sorted(imported(name))) or 'none'}" for name in floor]
        row, bottom = _row(floor, hints, y, "#e3eef7")
        parts += row
        y = bottom + GAP
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="-4 -4 {WIDTH + 8} {y:.0f}" '
        'font-family="sans-serif" font-size="14">\n' + "\n".join(parts) + "\n</svg>\n"
    )


if __name__ == "__main__":
    PICTURE.write_text(draw(), encoding="utf-8")
