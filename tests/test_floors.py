"""The order of the packages: a module imports from lower floors only.

gmsh and weak forms have one package each, and no file is too long.
"""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

import femnl

PACKAGE = Path(__file__).parents[1] / "femnl"
# A kind of measurement is a folder of observe, whichever there are.
KINDS = tuple(
    f"observe.{path.parent.name}" for path in sorted(PACKAGE.glob("observe/*/__init__.py"))
)
FLOORS = (
    ("core",),
    (
        "device",
        "io",
        "mechanics",
        "observe",
        "optics",
        "device.geometry",
        "io.measurement",
        "mechanics.fem",
    ),
    (
        "device.layout",
        "device.mesh",
        "mechanics.prestress",
        "mechanics.modes",
        "mechanics.nonlinearity",
        "resonator",
        "optics.fringe",
        "optics.harmonics",
        "optics.sampled",
        "optics.unit_fringe",
        "io.labfiles",
        "io.results",
    ),
    (
        "mechanics.lattice",
        "mechanics.static_deflection",
        "mechanics.bands",
        "mechanics.compression",
        "mechanics.tension",
    ),
    ("pipeline",),
    ("observe.model", "observe.film"),
    ("observe.extended", "observe.free_forms", "observe.noisy"),
    ("observe.score_directions",),
    KINDS,
    ("effects",),
    ("sweep", "fits", "validation"),
    ("diagnose",),
    ("chip",),
    ("plot", "published"),
    ("report",),
    ("cli",),
    ("__main__",),
)
# The front of the library, femnl itself, lends names of floors up to predict; floors above it may
# use it.
FRONT = 10
FLOOR = {"": FRONT} | {module: floor for floor, modules in enumerate(FLOORS) for module in modules}
ONLY_IMPORTER = {"gmsh": "device.mesh"}
FORMS = {"BilinearForm", "LinearForm", "Functional"}
LINES = 400

NAMES = set(femnl.__all__)

FILES = sorted(PACKAGE.rglob("*.py"))


def module_of(path: Path) -> str:
    """Name the module of a file as the table does; the root is ''."""
    parts = path.relative_to(PACKAGE).with_suffix("").parts
    return "" if parts == ("__init__",) else room(parts)


def room(parts: tuple[str, ...]) -> str:
    """Return the longest beginning of a dotted name that the table knows, else its first part."""
    known = [".".join(parts[:n]) for n in range(len(parts), 0, -1)]
    return next((name for name in known if name in FLOOR), parts[0])


def imports(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Every import in the source, wherever it stands, as (line, dotted name).

    `from a import b` gives a.b.
    """
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            prefix = "." * node.level + (node.module or "")
            yield from ((node.lineno, f"{prefix}.{alias.name}") for alias in node.names)
        elif isinstance(node, ast.Call) and ast.unparse(node.func).split(".")[-1] in (
            "import_module",
            "__import__",
        ):
            yield from (
                (node.lineno, arg.value)
                for arg in node.args
                if isinstance(arg, ast.Constant) and isinstance(arg.value, str)
            )


def faults(source: str, module: str) -> list[str]:
    """What the source of a module does against the rules of the house, one line each."""
    found = []
    for line, name in imports(ast.parse(source)):
        parts = name.split(".")
        if name.startswith("."):
            found.append(
                f"line {line}: relative import {name}; write femnl.… so that the floor shows"
            )
        if parts[0] in ONLY_IMPORTER and module != ONLY_IMPORTER[parts[0]]:
            found.append(f"line {line}: only femnl.{ONLY_IMPORTER[parts[0]]} imports {parts[0]}")
        if parts[0] == "skfem" and parts[-1] in FORMS and module != "mechanics.fem":
            found.append(
                f"line {line}: weak forms live in femnl.mechanics.fem only, not {parts[-1]} here"
            )
        if parts[0] != "femnl" or not module or module not in FLOOR:
            continue
        target = room(tuple(parts[1:])) if len(parts) > 1 else ""
        if target not in FLOOR and target in NAMES:
            target = ""
        if target not in FLOOR:
            found.append(
                f"line {line}: imports {name}, which is no module in the table of "
                "tests/test_floors.py"
            )
        elif target != module and FLOOR[target] >= FLOOR[module]:
            found.append(
                f"line {line}: {module} (floor {FLOOR[module]}) imports {target or 'femnl'} "
                f"(floor {FLOOR[target]})"
            )
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
    assert not missing, (
        f"the table of tests/test_floors.py names {sorted(missing)}, which are not there"
    )


def test_every_module_has_a_floor() -> None:
    homeless = {module_of(path) for path in FILES} - set(FLOOR)
    assert not homeless, f"give {sorted(homeless)} a floor in the table of tests/test_floors.py"


@pytest.mark.parametrize(
    ("module", "source", "fault"),
    [
        (
            "mechanics.fem",
            "from femnl.device.mesh import cut",
            "mechanics.fem (floor 1) imports device.mesh (floor 2)",
        ),
        (
            "mechanics.modes",
            "from femnl.device import mesh",
            "mechanics.modes (floor 2) imports device.mesh (floor 2)",
        ),
        (
            "mechanics.modes",
            "def f():\n    import femnl.cli",
            "line 2: mechanics.modes (floor 2) imports cli (floor 15)",
        ),
        ("mechanics.modes", "from .types import device", "relative import"),
        ("mechanics.modes", "import femnl", "mechanics.modes (floor 2) imports femnl (floor 10)"),
        (
            "mechanics.modes",
            "from femnl import load",
            "mechanics.modes (floor 2) imports femnl (floor 10)",
        ),
        ("mechanics.modes", "from femnl import nowhere", "no module in the table"),
        (
            "mechanics.modes",
            "from importlib import import_module\nimport_module('femnl.plot')",
            "imports plot (floor 13)",
        ),
        ("mechanics.modes", "import gmsh", "only femnl.device.mesh imports gmsh"),
        (
            "mechanics.modes",
            "from skfem import BilinearForm",
            "weak forms live in femnl.mechanics.fem only",
        ),
    ],
)
def test_the_rules_of_the_house_catch(module: str, source: str, fault: str) -> None:
    assert any(fault in line for line in faults(source, module))


@pytest.mark.parametrize(
    ("module", "source"),
    [
        ("device.mesh", "import gmsh\nfrom femnl.core.device import Model"),
        ("mechanics.fem", "from skfem import BilinearForm"),
        ("fits", "from femnl.fits.start import guess"),
        ("", "from femnl import cli"),
        ("cli", "import femnl\nfrom femnl import __version__"),
    ],
)
def test_the_rules_of_the_house_allow(module: str, source: str) -> None:
    assert faults(source, module) == []
