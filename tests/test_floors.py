"""The house of femnl: a module imports from lower floors only, gmsh and weak forms have one room each, and no room is too large."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

import femnl

FLOORS = (
    ("types", "errors", "resources", "compiled", "processes"),
    ("geometry", "measurement", "fem"),
    ("mesh", "prestress", "modes", "nonlinearity", "resonator", "optics", "readout", "labfiles", "storage"),
    ("effects", "lattice", "bow", "bands"),
    ("predict",),
    ("sweep", "fits", "validation"),
    ("diagnose",),
    ("plot",),
    ("report",),
    ("cli",),
    ("__main__",),
)
# The front of the library, femnl itself, lends names of floors up to predict; floors above it may use it.
FRONT = 5
FLOOR = {"": FRONT} | {module: floor for floor, modules in enumerate(FLOORS) for module in modules}
ONLY_IMPORTER = {"gmsh": "mesh"}
FORMS = {"BilinearForm", "LinearForm", "Functional"}
LINES = 300

NAMES = set(femnl.__all__)

PACKAGE = Path(__file__).parents[1] / "femnl"
FILES = sorted(PACKAGE.rglob("*.py"))


def module_of(path: Path) -> str:
    """Name the module of a file, relative to the package: a sub-package counts as one module, the root as ''."""
    first = path.relative_to(PACKAGE).parts[0]
    return "" if first == "__init__.py" else first.removesuffix(".py")


def imports(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Every import in the source, wherever it stands, as (line, dotted name); `from a import b` gives a.b."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            prefix = "." * node.level + (node.module or "")
            yield from ((node.lineno, f"{prefix}.{alias.name}") for alias in node.names)
        elif isinstance(node, ast.Call) and ast.unparse(node.func).split(".")[-1] in ("import_module", "__import__"):
            yield from ((node.lineno, arg.value) for arg in node.args if isinstance(arg, ast.Constant) and isinstance(arg.value, str))


def faults(source: str, module: str) -> list[str]:
    """What the source of a module does against the rules of the house, one line each."""
    found = []
    for line, name in imports(ast.parse(source)):
        parts = name.split(".")
        if name.startswith("."):
            found.append(f"line {line}: relative import {name}; write femnl.… so that the floor shows")
        if parts[0] in ONLY_IMPORTER and module != ONLY_IMPORTER[parts[0]]:
            found.append(f"line {line}: only femnl.{ONLY_IMPORTER[parts[0]]} imports {parts[0]}")
        if parts[0] == "skfem" and parts[-1] in FORMS and module != "fem":
            found.append(f"line {line}: weak forms live in femnl.fem only, not {parts[-1]} here")
        if parts[0] != "femnl" or not module or module not in FLOOR:
            continue
        target = parts[1] if len(parts) > 1 else ""
        if target not in FLOOR and target in NAMES:
            target = ""
        if target not in FLOOR:
            found.append(f"line {line}: imports {name}, which is no module in the table of tests/test_floors.py")
        elif target != module and FLOOR[target] >= FLOOR[module]:
            found.append(f"line {line}: {module} (floor {FLOOR[module]}) imports {target or 'femnl'} (floor {FLOOR[target]})")
    return found


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_imports_point_to_a_lower_floor(path: Path) -> None:
    assert not faults(path.read_text(encoding="utf-8"), module_of(path))


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_a_file_stays_readable_in_one_go(path: Path) -> None:
    n_lines = len(path.read_text(encoding="utf-8").splitlines())
    assert n_lines <= LINES, f"{n_lines} lines: make it a package of smaller files"


def test_every_module_of_the_table_exists() -> None:
    missing = set(FLOOR) - {module_of(path) for path in FILES}
    assert not missing, f"the table of tests/test_floors.py names {sorted(missing)}, which are not there"


def test_every_module_has_a_floor() -> None:
    homeless = {module_of(path) for path in FILES} - set(FLOOR)
    assert not homeless, f"give {sorted(homeless)} a floor in the table of tests/test_floors.py"


@pytest.mark.parametrize(
    ("module", "source", "fault"),
    [
        ("fem", "from femnl.mesh import cut", "fem (floor 1) imports mesh (floor 2)"),
        ("modes", "from femnl import mesh", "modes (floor 2) imports mesh (floor 2)"),
        ("modes", "def f():\n    import femnl.cli", "line 2: modes (floor 2) imports cli (floor 9)"),
        ("modes", "from .types import device", "relative import"),
        ("modes", "import femnl", "modes (floor 2) imports femnl (floor 5)"),
        ("modes", "from femnl import load", "modes (floor 2) imports femnl (floor 5)"),
        ("modes", "from femnl import nowhere", "no module in the table"),
        ("modes", "from importlib import import_module\nimport_module('femnl.plot')", "imports plot (floor 7)"),
        ("modes", "import gmsh", "only femnl.mesh imports gmsh"),
        ("modes", "from skfem import BilinearForm", "weak forms live in femnl.fem only"),
    ],
)
def test_the_rules_of_the_house_catch(module: str, source: str, fault: str) -> None:
    assert any(fault in line for line in faults(source, module))


@pytest.mark.parametrize(
    ("module", "source"),
    [
        ("mesh", "import gmsh\nfrom femnl.types.device import Model"),
        ("fem", "from skfem import BilinearForm"),
        ("fits", "from femnl.fits.start import guess"),
        ("", "from femnl import cli"),
        ("cli", "import femnl\nfrom femnl import __version__"),
    ],
)
def test_the_rules_of_the_house_allow(module: str, source: str) -> None:
    assert faults(source, module) == []
