"""Both forms of every cause: the library's equation and the way the laboratory computes it.

`python -m tests.blind.forms` writes docs/reference/two-forms.md.
"""

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from femnl.effects import library
from tests.blind.lab import KINDS
from tests.blind.lab.laws import LAWS

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "reference" / "two-forms.md"
LAB = ROOT / "tests" / "blind" / "lab"
LIBRARY = ("femnl/effects", "femnl/observe", "femnl/fits")
LEAST = 5
"""Operations from which on two equal formulas are no accident."""
Formula = tuple[object, ...]
HEAD = (
    "# Two forms of every cause\n\n"
    "A test that hides a cause by the equation that later looks for it proves only that both "
    "agree. The laboratory of the tests computes each cause in another way than the library. "
    "`tests/blind/test_forms.py` fails where the laboratory imports a model of femnl or restates "
    "one of its formulas.\n\n"
    "The first law is the library's equation, computed in another way; of signals of many hundred "
    "σ the two may differ by more than the noise where the library's is an expansion. The "
    "second law is another equation: by its value `inexact` it is the first one at 0, and the "
    "realistic study (`python -m tests.blind.realistic`) sets it so that the best first law leaves "
    "0.1 to 20 % of the cause. Where t is given, it goes from −1 for the longest measured wave to "
    "1 for the shortest; e is `inexact`.\n\n"
    "| cause | in the library | in the laboratory | second law |\n"
    "|---|---|---|---|\n"
)


def derived() -> dict[str, list[str]]:
    """Return how the laboratory computes each cause, the ways of all kinds of measurement."""
    found: dict[str, list[str]] = {}
    for bench in KINDS.values():
        for name, way in getattr(bench, "DERIVED", {}).items():
            if way not in found.setdefault(name, []):
                found[name].append(way)
    return found


def second_laws() -> dict[str, list[str]]:
    """Return what each cause does otherwise than an equation says, of all kinds of measurement."""
    found: dict[str, list[str]] = {}
    for laws in LAWS.values():
        for name, way in laws.items():
            if way not in found.setdefault(name, []):
                found[name].append(way)
    return found


def page() -> str:
    """Return the page that lists both forms side by side."""
    ways = derived()
    second = second_laws()
    rows = [
        f"| `{effect.name}` | {_cell(effect.equation)} | {_cell('; '.join(ways[effect.name]))} | "
        f"{_cell('; '.join(second[effect.name]))} |\n"
        for effect in library().values()
    ]
    return HEAD + "".join(rows)


def _cell(text: str) -> str:
    return text.replace("|", r"\|").replace("_", r"\_").replace("*", r"\*")


def formulas(path: Path) -> dict[Formula, str]:
    """Return the formulas of a file with at least `LEAST` operations, with their source.

    Names do not count, nor the order of sums and products.
    """
    found = {}
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.BinOp):
            formula = _formula(node)
            if _operations(formula) >= LEAST:
                found[formula] = f"{path.name}:{node.lineno}: {ast.unparse(node)}"
    return found


@cache
def library_formulas() -> dict[Formula, str]:
    """Return the formulas of the effects and of the models that they act in."""
    found: dict[Formula, str] = {}
    for folder in LIBRARY:
        for path in sorted((ROOT / folder).rglob("*.py")):
            found |= formulas(path)
    return found


def _formula(node: ast.expr) -> Formula:
    """Return a formula without its names."""
    if isinstance(node, ast.BinOp):
        parts = [_formula(part) for part in _parts(node)]
        if isinstance(node.op, ast.Add | ast.Mult):
            parts.sort(key=repr)
        return (type(node.op).__name__, *parts)
    if isinstance(node, ast.UnaryOp):
        return (type(node.op).__name__, _formula(node.operand))
    if isinstance(node, ast.Call):
        name = node.func.attr if isinstance(node.func, ast.Attribute) else ast.unparse(node.func)
        return (f"{name}()", *(_formula(argument) for argument in node.args))
    return (repr(node.value) if isinstance(node, ast.Constant) else "name",)


def _parts(node: ast.BinOp) -> Iterator[ast.expr]:
    """Yield the terms of a sum, or the factors of a product, however they are bracketed."""
    for side in (node.left, node.right):
        same = isinstance(side, ast.BinOp) and type(side.op) is type(node.op)
        if same and isinstance(side, ast.BinOp) and isinstance(node.op, ast.Add | ast.Mult):
            yield from _parts(side)
        else:
            yield side


def _operations(formula: Formula) -> int:
    inner = [part for part in formula if isinstance(part, tuple)]
    return bool(inner) + sum(_operations(part) for part in inner)


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
