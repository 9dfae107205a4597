"""What every table of a geometry file shares.

Strict types, no unknown keys, and errors in one line each.
"""

import json
import re
from typing import Any

from pydantic import BaseModel, ConfigDict, ValidationError, model_validator

from femnl.core.errors import one_line, suggest
from femnl.device.geometry.quantities import refusal

EXAMPLES = {
    "angle": '"30 deg"',
    "at": '["10 um", "0 um"]',
    "beam": '"2 um"',
    "beams": '["100 um", "200 um"]',
    "defect": '"100 um"',
    "distance": '"30 um"',
    "pad": '"100 um"',
    "span": '"700 um"',
    "tether": '"5 um"',
    "tethers": "8",
    "arcs": '[{edge = 2, through = ["10 um", "20 um"]}]',
    "clamped": "true",
    "fillet": '"5 um"',
    "semi_axes": '["4 um", "2 um"]',
    "through": '["10 um", "20 um"]',
    "assumed": '["film.density", "holes.radius"]',
    "bending": "true",
    "centres": '[["-20 um", "0 um"], ["20 um", "0 um"]]',
    "count": "[30, 30]",
    "deflection": '"20 GPa"',
    "density": '"3100 kg/m^3"',
    "diameter": '"270 um"',
    "draw": '"10 nm"',
    "edge": '"clamped"',
    "etch_radius": '"10.88 um"',
    "free": "[2, 3]",
    "gap": '"3226.25 nm"',
    "gradient": '["0.1 nm/um", "0 nm/um"]',
    "grid": '"1 nm"',
    "height": '"180 um"',
    "index": '{"632.8 nm" = 2.0395, "532 nm" = "4.1366 - 0.0338i"}',
    "kind": '"square"',
    "lattice": '"square"',
    "long_axis": '"278.7 um"',
    "material": '"SiN"',
    "name": '"square-270um"',
    "normal": '"20 GPa"',
    "offset": '["1 um", "0 um"]',
    "operation": '"subtract"',
    "parts": '[{shape = {kind = "square", side = "100 um"}}]',
    "pitch": '"8.56 um"',
    "points": '[["0 um", "0 um"], ["270 um", "0 um"], ["0 um", "270 um"]]',
    "poisson": "0.23",
    "quality_factor": "5e3",
    "radius": '"0.9 um"',
    "rings": "15",
    "rotation": '"0.2 mN"',
    "shape": '{kind = "square", side = "10 um"}',
    "shear": '"20 GPa"',
    "side": '"270 um"',
    "sides": "6",
    "source": '"measured in 2025"',
    "stress": '"1101.5 MPa"',
    "surface": '"6e10 m^-1"',
    "surface_error": '"4e10 m^-1"',
    "taper": '"60 nm"',
    "taper_length": '"4 um"',
    "thickness": '"183.75 nm"',
    "volume": "28000",
    "width": '"270 um"',
    "young": '"250 GPa"',
}
"""How to write each key that may be missing or of the wrong type."""

_UNIONS = ("outline", "holes")  # pydantic puts the kind that it chose into the path of an error
_LONGEST = 60
_PYDANTIC = re.compile(r"^(Input should be|\w+ should have)")


class Table(BaseModel):
    """A table whose keys are all known and whose values have exactly the declared types."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True, allow_inf_nan=False)

    @model_validator(mode="before")
    @classmethod
    def _refuse_unknown_keys(cls, data: Any) -> Any:
        """Look for unknown keys first.

        a misspelt key is both unknown and missing, and the spelling is the cause.
        """
        for key in data if isinstance(data, dict) else ():
            if key not in cls.model_fields:
                raise refusal(f"unknown key, {suggest(key, list(cls.model_fields))}", key)
        return data


def complaint(error: ValidationError) -> str:
    """Return the first error as one line: `[table] key = value: what was expected`."""
    first = error.errors(include_url=False)[0]
    context = first.get("ctx", {})
    value = first["input"]
    loc = list(first["loc"])
    group = loc.pop(1) if len(loc) > 1 and loc[0] == "holes" else 0
    if len(loc) > 1 and loc[0] in _UNIONS:
        del loc[1]
    if "shape" in loc[:-1]:
        del loc[loc.index("shape") + 1]
    if group:  # the first of several groups of holes is called as one that is alone
        loc.insert(1, group)
    if first["type"] == "missing":
        return f"{_place(loc, table=loc[-1] not in EXAMPLES)} is missing: {_how_to_write(loc)}"
    if first["type"] == "union_tag_not_found":
        loc.append(context["discriminator"].strip("'"))
        return f"{_place(loc, table=loc[-1] not in EXAMPLES)} is missing: {_how_to_write(loc)}"
    if first["type"] == "union_tag_invalid":
        loc.append(context["discriminator"].strip("'"))
        reason = suggest(context["tag"], context["expected_tags"].replace("'", "").split(", "))
        value = value[loc[-1]]
    elif first["type"] == "geometry":
        reason = context["reason"]
        if context["key"] is not None:
            loc.append(context["key"])
            value = value[context["key"]]
    elif first["type"] in ("model_type", "model_attributes_type"):
        reason = f"expected a table, {_how_to_write(loc)}"
    else:
        reason = (
            f"{_PYDANTIC.sub('expected', first['msg']).replace(' after validation', '')}, "
            f"{_how_to_write(loc)}"
        )
    if isinstance(value, dict):
        return one_line(f"{_place(loc, table=True)}: {reason}")
    return one_line(f"{_place(loc)} = {show(value)}: {reason}")


def show(value: Any) -> str:
    """Return a value much as TOML writes it, shortened where it is long."""
    # Decimal digits of huge numbers take for ever
    if isinstance(value, int) and abs(value) >= 10**18:
        text = hex(value)
    elif isinstance(value, list):
        text = f"[{', '.join(show(v) for v in value[:4])}{', …' if len(value) > 4 else ''}]"
    elif isinstance(value, dict):
        text = f"{{{', '.join(f'{k} = {show(v)}' for k, v in list(value.items())[:4])}}}"
    else:
        text = json.dumps(value, ensure_ascii=False, default=str)
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}…"


def _place(loc: list[Any], table: bool = False) -> str:
    """Return where a value stands.

    The table in brackets, its key, and entries of lists counted from 1.
    """
    words = [str(part + 1) if isinstance(part, int) else part for part in loc]
    if len(loc) > 2 and isinstance(loc[-2], int) and isinstance(loc[-1], int):
        words[-1] = "xy"[loc[-1]] if loc[-1] < 2 else words[-1]
    if len(loc) > 1 or table:
        words[0] = f"[{words[0]}]"
    return " ".join(words)


def _how_to_write(loc: list[Any]) -> str:
    keys = [part for part in loc if isinstance(part, str)]
    if keys == ["layers", "side"]:  # of the film, not of a square
        return 'write e.g. side = "top"'
    if keys[-1] in EXAMPLES:
        return f"write e.g. {keys[-1]} = {EXAMPLES[keys[-1]]}"
    return f"write a table [{keys[-1]}], as in the shipped geometries"
