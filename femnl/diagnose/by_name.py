"""Jobs and results as bytes, with names in the place of what each process has."""

from collections.abc import Mapping
from io import BytesIO
from pickle import Pickler, Unpickler
from typing import Any

from femnl.core.checkpoint import Checkpoint
from femnl.core.effect import Effect
from femnl.observe.model import MeasurementModel


class ByName:
    """Sends the model, the effects and the checkpoint by name: each process has its own."""

    def __init__(
        self, base_model: MeasurementModel, effects: list[Effect], checkpoint: Checkpoint | None
    ) -> None:
        thin = base_model.thinned
        self._things: dict[str, object] = {
            "base_model": base_model,
            "part of base_model": None if thin is None else thin.model,
            "checkpoint": checkpoint,
            **{f"effect {effect.name}": effect for effect in effects},
        }
        self._by_id = {id(thing): name for name, thing in self._things.items() if thing is not None}

    def packed(self, thing: object) -> bytes:
        """Return a job or what it found as bytes, with names in the place of what has one."""
        stream = BytesIO()
        _Packer(stream, self._by_id).dump(thing)
        return stream.getvalue()

    def unpacked(self, content: bytes) -> Any:
        """Return what was packed in another process, with what has a name as it is here."""
        return _Unpacker(BytesIO(content), self._things).load()


class _Packer(Pickler):
    """Writes the names of objects that each process has."""

    def __init__(self, stream: BytesIO, names: Mapping[int, str]) -> None:
        super().__init__(stream)
        self._by_id = names

    def persistent_id(self, part: object) -> str | None:
        """Return the name of an object, None where it is to be written itself."""
        return self._by_id.get(id(part))


class _Unpacker(Unpickler):
    """Puts the objects of this process in the place of their names."""

    def __init__(self, stream: BytesIO, things: Mapping[str, object]) -> None:
        super().__init__(stream)
        self._things = things

    def persistent_load(self, name: str) -> object:
        """Return the object of a name."""
        return self._things[name]
