"""`femnl effects`: the causes that a diagnosis knows."""

from femnl.cli._device import EffectsFolder, Json
from femnl.cli._output import console, print_json, table


def command(folder: EffectsFolder = None, as_json: Json = False) -> None:
    """List the physical causes that can hide in data: equation, parameters, kinds of data."""
    from femnl.effects import known

    effects = known(folder).values()
    if as_json:
        names = ("name", "equation", "kinds", "source", "limits", "sentence")
        print_json(
            {
                "effects": [
                    {n: getattr(e, n) for n in names}
                    | {"parameters": [vars(k) for k in e.parameters]}
                    for e in effects
                ]
            }
        )
        return
    rows = [
        [
            e.name,
            e.equation,
            ", ".join(f"{k.name} [{k.unit}]" for k in e.parameters),
            ", ".join(e.kinds),
        ]
        for e in effects
    ]
    console().print(table("Effects", ["name", "equation", "parameters", "shows in"], rows))
