"""`femnl effects`: the causes that a diagnosis knows, and how strong each of them can be."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from femnl.cli._device import EffectsFolder, Json
from femnl.cli._output import console, print_json, scientific, table

if TYPE_CHECKING:
    from femnl.core.effect import Effect, ParameterSpec

Name = Annotated[
    str | None,
    typer.Argument(help="One effect, with its bounds and their reasons.", show_default=False),
]


def command(name: Name = None, folder: EffectsFolder = None, as_json: Json = False) -> None:
    """List the physical causes that can hide in data; of one, its bounds and limits."""
    from femnl.effects import known

    effects = known(folder)
    chosen = list(effects.values()) if name is None else [_named(name, effects)]
    if as_json:
        print_json({"effects": [_described(effect) for effect in chosen]})
    elif name is None:
        rows = [
            [e.name, e.equation, ", ".join(_with_unit(p) for p in e.parameters), ", ".join(e.kinds)]
            for e in chosen
        ]
        console().print(table("Effects", ["name", "equation", "parameters", "shows in"], rows))
    else:
        _show(chosen[0])


def _named(name: str, effects: dict[str, Effect]) -> Effect:
    from femnl.core.errors import ParameterError

    if name not in effects:
        raise ParameterError(f"{name}: no such effect; `femnl effects` lists them")
    return effects[name]


def _described(effect: Effect) -> dict[str, object]:
    names = (
        "name",
        "equation",
        "kinds",
        "source",
        "limits",
        "sentence",
        "accuracy",
        "accuracy_reason",
        "imitates",
    )
    parameters = [vars(parameter) for parameter in effect.parameters]
    return {name: getattr(effect, name) for name in names} | {"parameters": parameters}


def _show(effect: Effect) -> None:
    rows = [
        [
            p.name,
            scientific(p.low, 3),
            scientific(p.high, 3),
            f"{p.scale} [{p.unit}]" if p.scale else p.unit,
            p.reason,
        ]
        for p in effect.parameters
    ]
    head = ["parameter", "at least", "at most", "times", "why"]
    console().print(table(f"{effect.name}: {effect.sentence}", head, rows))
    console().print(f"accuracy: {effect.accuracy:.1%} of what it does; {effect.accuracy_reason}")
    if effect.imitates:
        console().print(f"takes up in another's place, at most: {imitated(effect)}")
    for what in ("equation", "limits", "source"):
        console().print(f"{what}: {getattr(effect, what)}".replace("[", r"\["))
    console().print(f"shows in: {', '.join(effect.kinds)}")


def imitated(effect: Effect) -> str:
    """Return how much of other causes an effect takes up in their place, by kind."""
    return "; ".join(
        f"{kind}: " + ", ".join(f"{part:.0%} of {_cause(name)}" for name, part in parts.items())
        for kind, parts in sorted(effect.imitates.items())
    )


def _cause(name: str) -> str:
    from femnl.core.effect import UNKNOWN

    return "what no library has" if name == UNKNOWN else name


def _with_unit(parameter: ParameterSpec) -> str:
    return parameter.name if parameter.unit == "1" else f"{parameter.name} [{parameter.unit}]"
