"""Physical causes that can hide in data, one file each; a new file is found by itself.

Those of other packages are found by their entry points, those of a folder by its path.
"""

import hashlib
import sys
from collections.abc import Iterable
from dataclasses import replace
from functools import cache
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from types import FunctionType, ModuleType
from uuid import uuid4

from femnl.core.effect import Change, Effect, EffectFile
from femnl.core.errors import ParameterError
from femnl.core.kinds import kinds
from femnl.core.plugins import Defined, by_name, constant_of, plug_ins, refusal, sources
from femnl.core.resources import need_folder

__all__ = ["fingerprint", "from_folder", "known", "library", "read_effect"]

GROUP = "femnl.effects"
"""Entry points of this group name modules that define EFFECT."""


@cache
def library() -> dict[str, Effect]:
    """Return every effect by name: the constant EFFECT of each file here, and of each plug-in.

    Raises: ParameterError for a plug-in that defines no effect, or none that any data can show.
    """
    return by_name(_defined())


def from_folder(folder: str | Path) -> dict[str, Effect]:
    """Return the effects of a folder by name: the constant EFFECT of each of its *.py files.

    Files whose names begin with an underscore are left out. The files are run.

    Raises: ParameterError for a folder that is missing or holds no such file, a file that cannot
    be run or defines no effect, and an effect of a name that the library or another file has.
    """
    folder = need_folder(Path(folder))
    files = sorted(file for file in folder.glob("*.py") if not file.name.startswith("_"))
    if not files:
        raise ParameterError(f"{folder}: holds no *.py file; put a file there that defines EFFECT")
    found = [Defined(read_effect(_opened(file)), str(file)) for file in files]
    known = library()
    return {name: e for name, e in by_name([*_defined(), *found]).items() if name not in known}


def known(folder: str | Path | None = None) -> dict[str, Effect]:
    """Return the library, with the effects of a folder where one is given.

    Raises: ParameterError as `library` and `from_folder`.
    """
    return library() if folder is None else library() | from_folder(folder)


@cache
def read_effect(file: EffectFile) -> Effect:
    """Return the effect that a file defines; the same one for the same file and text.

    Raises: ParameterError as `from_folder`.
    """
    digest = hashlib.sha256(file.text).hexdigest()[:16]
    # No name that can be imported: only who has read the file has this module.
    module = ModuleType(f"<effect {Path(file.path).stem} {digest}>")
    module.__file__ = str(Path(file.path).absolute())
    sys.modules[module.__name__] = module
    try:
        exec(compile(file.text, file.path, "exec"), vars(module))
    except (Exception, SystemExit) as error:
        del sys.modules[module.__name__]
        raise refusal(file.path, error, "repair the file or take it out of the folder") from error
    effect = constant_of(module, "EFFECT", Effect, file.path)
    _check(effect, file.path)
    return replace(effect, file=file)


def fingerprint(effects: Iterable[Effect]) -> str:
    """Return a digest of effects: their numbers, and the source outside of femnl that they run.

    Of an effect without source, as of a notebook, it is another one each time.
    """
    return hashlib.sha256(repr([_described(effect) for effect in effects]).encode()).hexdigest()


@cache
def _defined() -> tuple[Defined[Effect], ...]:
    """Return the effects of this folder, then those of plug-ins, and where each is from."""
    names = [f"{__name__}.{found.name}" for found in iter_modules(__path__)]
    own = [
        Defined(constant_of(import_module(name), "EFFECT", Effect, name), name) for name in names
    ]
    found = (*own, *plug_ins(GROUP, "EFFECT", Effect))
    for one in found:
        _check(one.value, one.where)
    return found


def _opened(file: Path) -> EffectFile:
    try:
        return EffectFile(str(file), file.read_bytes())
    except OSError as error:
        raise ParameterError(
            f"{file}: cannot be read ({error.strerror}); check the file and its permissions"
        ) from error


def _check(effect: Effect, where: str) -> None:
    """Refuse an effect that no data could show, and ranges that count in unknown numbers."""
    stages = {stage for spec in kinds().values() for stage in spec.stages}
    for stage in effect.changes:
        if stage not in stages:
            raise ParameterError(
                f"{where}: no kind of measurement has the stage {stage!r}; the stages are "
                f"{', '.join(sorted(stages))}"
            )
    shown = [spec for spec in kinds().values() if not effect.changes.keys().isdisjoint(spec.stages)]
    scales = {scale for spec in shown for scale in spec.scales}
    if any(spec.contract is not None and spec.contract.free for spec in shown):
        # A control variable that a file may name gives the same numbers as the known ones
        scales |= {f"{form}{need}" for form in ("", "per_") for need in effect.needs}
    for parameter in effect.parameters:
        if parameter.scale and parameter.scale not in scales:
            raise ParameterError(
                f"{where}: the scale {parameter.scale!r} of {parameter.name} is given by no kind "
                f"that the effect shows in; these give {', '.join(sorted(scales))}"
            )


def _described(effect: Effect) -> tuple[object, ...]:
    """Return what the fits with an effect depend on, beside the code of femnl."""
    numbers = (
        effect.name,
        effect.parameters,
        sorted(effect.changes),
        effect.needs,
        effect.replaces,
        effect.shared,
        effect.couples_blocks,
        effect.accuracy,
        effect.one_material,
    )
    return *numbers, _source(effect)


def _source(effect: Effect) -> object:
    """Return the source of an effect outside of femnl."""
    if effect.file is not None:
        return effect.file.text
    listed = [one.source for one in _defined() if one.value is effect]
    if listed:
        return listed
    names = sorted({_module(change) for change in effect.changes.values()})
    others = [name for name in names if name.partition(".")[0] != "femnl"]
    found = [sources(sys.modules[name]) if name in sys.modules else {} for name in others]
    # Code that cannot be compared never passes for what it was.
    return found if all(found) else uuid4()


def _module(change: Change) -> str:
    """Return the module of a plain function; "" for what else can be called."""
    return change.__module__ if isinstance(change, FunctionType) else ""
