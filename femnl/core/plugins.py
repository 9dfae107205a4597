"""What packages of others add: the modules that their entry points name, and a constant of each."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from types import ModuleType
from typing import Generic, Protocol, TypeVar

from femnl.core.errors import ParameterError, one_line


class Named(Protocol):
    """Has a name, which no other of its sort has."""

    @property
    def name(self) -> str:
        """As used in files and messages."""


T = TypeVar("T")
N = TypeVar("N", bound=Named)


@dataclass(frozen=True)
class Defined(Generic[T]):
    """What a module or a file defines.

    value: the constant. where: the words that name module or file in messages. source: what it
    rests on outside of femnl, see `sources`.
    """

    value: T
    where: str
    source: Mapping[str, bytes] = field(default_factory=dict, repr=False)


def plug_ins(group: str, constant: str, kind: type[T]) -> list[Defined[T]]:
    """Return what the entry points of a group add, by the names of these.

    Args:
        group: such as "femnl.effects"; each of its entry points names a module.
        constant: the name under which such a module defines what it adds.
        kind: the type of that constant.

    Raises: ParameterError for a module that cannot be imported, or without that constant.
    """
    entries = sorted(entry_points(group=group), key=lambda entry: (entry.name, entry.value))
    return [_plugged(entry, constant, kind) for entry in entries]


def _plugged(entry: EntryPoint, constant: str, kind: type[T]) -> Defined[T]:
    package = "its package" if entry.dist is None else entry.dist.name
    where = f"{entry.value} (entry point {entry.name} of {package})"
    try:
        module = import_module(entry.value)
    except (Exception, SystemExit) as error:
        raise refusal(where, error, f"repair or uninstall {package}") from error
    return Defined(constant_of(module, constant, kind, where), where, sources(module))


def refusal(where: str, error: BaseException, remedy: str) -> ParameterError:
    """Say in one line what code of others raised when it was run."""
    return ParameterError(one_line(f"{where}: {type(error).__name__}: {error}; {remedy}"))


def constant_of(module: ModuleType, constant: str, kind: type[T], where: str) -> T:
    """Return a constant of a module.

    Raises: ParameterError, which names `where`, if it is missing or of another type.
    """
    if not hasattr(module, constant):
        raise ParameterError(
            f"{where}: defines no {constant}; set {constant} = {kind.__name__}(…) there"
        )
    value = getattr(module, constant)
    if not isinstance(value, kind):
        raise ParameterError(
            f"{where}: {constant} is of type {type(value).__name__}; make it one of "
            f"{kind.__module__}.{kind.__name__}"
        )
    return value


def by_name(found: Iterable[Defined[N]]) -> dict[str, N]:
    """Return what was found by its name.

    Raises: ParameterError, which names both places, where two have one name.
    """
    places: dict[str, str] = {}
    named: dict[str, N] = {}
    for one in found:
        name = one.value.name
        if name in named:
            raise ParameterError(
                f"{one.where}: the name {name!r} is taken by {places[name]}; choose another"
            )
        places[name] = one.where
        named[name] = one.value
    return named


def sources(module: ModuleType) -> Mapping[str, bytes]:
    """Return the source that a module rests on: every Python file of its outermost package.

    Each is named by its path within that package. A module outside of packages is one file; one
    without a file, as of a notebook, has no source.
    """
    if getattr(module, "__file__", None) is None:
        return {}
    file = Path(str(module.__file__))
    if "." not in module.__name__ and not hasattr(module, "__path__"):
        return {file.name: file.read_bytes()}
    folder = file.parent
    while (folder.parent / "__init__.py").is_file():
        folder = folder.parent
    files = sorted(folder.rglob("*.py"))
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}
