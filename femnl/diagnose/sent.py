"""The effects that a diagnosis considers, as it tells other processes of them."""

from collections import Counter
from collections.abc import Iterable

from femnl.core.effect import Effect, EffectFile
from femnl.core.errors import ParameterError
from femnl.effects import library, read_effect

Sent = Effect | EffectFile | str
"""An effect, the file of one, or the name of one of the library."""


def considered(effects: Iterable[Effect] | None) -> list[Effect]:
    """Return the effects to consider, all of the library unless given.

    Raises: ParameterError where two have one name.
    """
    pool = list(library().values() if effects is None else effects)
    names = Counter(effect.name for effect in pool)
    for name, count in names.items():
        if count > 1:
            raise ParameterError(
                f"effects: {count} are called {name!r}; give each a name of its own"
            )
    return pool


def sent(effects: Iterable[Effect], workers: int) -> list[Sent]:
    """Return effects as they may be sent to other processes.

    Effects of the library go by name, those of a folder as the file that was read, others as they
    are.

    Raises: ParameterError for an effect that other processes cannot import.
    """
    found = [_reference(effect) for effect in effects]
    for effect in found:
        if workers > 1 and isinstance(effect, Effect) and not _importable(effect):
            raise ParameterError(
                f"effects: {effect.name} is defined where other processes cannot import it; "
                "define it in a module, or diagnose one file with workers = 1"
            )
    return found


def received(effect: Sent) -> Effect:
    """Return an effect that was sent, as this process has it."""
    if isinstance(effect, str):
        return library()[effect]
    return read_effect(effect) if isinstance(effect, EffectFile) else effect


def _reference(effect: Effect) -> Sent:
    if library().get(effect.name) is effect:
        return effect.name
    # An effect that was changed since it was read is no longer that of its file.
    if effect.file is not None and read_effect(effect.file) is effect:
        return effect.file
    return effect


def _importable(effect: Effect) -> bool:
    """Whether modules define what an effect does: no function and no file of a folder does."""
    places = [
        f"{change.__module__} {getattr(change, '__qualname__', '')}"
        for change in effect.changes.values()
    ]
    return not any("<" in place for place in places)
