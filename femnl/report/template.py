"""The pages' templates: every page is one file, and text in it is escaped."""

import re
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined, Template
from markupsafe import Markup, escape

LETTER = r"A-Za-z\u0391-\u03c9"
"""Letters of indices, the Greek ones too."""
FORMS = (
    (re.compile(r"\^\{([^{}]*)\}"), r"<sup>\1</sup>"),
    (re.compile(r"_\{([^{}]*)\}"), r"<sub>\1</sub>"),
    (
        re.compile(rf"(?<![{LETTER}_])([{LETTER}]{{1,2}})_([{LETTER}0-9]+)"),
        r"\1<sub>\2</sub>",
    ),
)
"""Powers, indices in braces and indices of one or two letters, and how they are written."""


def template(name: str) -> Template:
    """Return a template of this folder; a name that it does not get is an error."""
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["formula"] = formula
    return environment.get_template(name)


def formula(text: str) -> Markup:
    """Return an equation in words with its indices set low and its powers set high.

    The words are those of `femnl.effects`: e^{−γt}, V^n, α_film, ξ_j. Words with an underscore,
    such as the names of parameters, stay as they are.
    """
    shown = str(escape(text))
    for mark, form in FORMS:
        shown = mark.sub(form, shown)
    return Markup(shown)
