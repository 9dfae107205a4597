"""Options of `femnl fit` that are no word it knows, or have no effect on what is read."""

from typing import TypeVar

import typer

from femnl.core.errors import ParameterError

Word = TypeVar("Word", bound=str)
OF_ONE_MODE = ("use", "background", "linear", "nonlinear_damping")
"""Options of a response that is one mode, and not several linear ones."""
# What each option is for: a kind of measurement, or a meaning of one.
APPLIES = {
    "use": ("response", "line-scan"),
    "nonlinear_damping": ("response", "line-scan"),
    "fringe": ("map", "trace"),
    "mode": ("map",),
    "n_harmonics": ("trace",),
    "held_out": ("oscillator",),
    "background": ("response",),
    "linear": ("response",),
    "fix": (
        "response",
        "line-scan",
        "spectrum",
        "map",
        "trace",
        "ring-down",
        "envelope",
        "oscillator",
        "decay",
        "series",
    ),
    "each_sweep_to": ("response",),
    "n_modes": ("response",),
    "law_name": ("series",),
    "against": ("series",),
}


def one_of(option: str, text: str, words: tuple[Word, ...]) -> Word:
    """Return the word that a text is. Raises: ParameterError for another text."""
    for known in words:
        if text == known:
            return known
    raise ParameterError(f"{option} {text}: expected one of {', '.join(words)}")


def _given(context: typer.Context) -> list[tuple[str, str]]:
    """Return the options that were given, as on the command line and by their names here."""
    found = []
    for parameter in context.command.params:
        name = parameter.name or ""
        source = context.get_parameter_source(name)
        if source is not None and source.name == "COMMANDLINE":
            found.append((parameter.opts[0], name))
    return found


def refuse_beside_modes(context: typer.Context) -> None:
    """Refuse an option that fits of several linear modes do not have."""
    for option, name in _given(context):
        if name in OF_ONE_MODE:
            raise ParameterError(
                f"{option}: --modes fits linear modes with real and imag on a smooth "
                "background; leave one of them out"
            )


def check_options(context: typer.Context, read_as: set[str]) -> None:
    """Refuse an option that was given and has no effect on what is read."""
    for option, name in _given(context):
        if name in APPLIES and read_as.isdisjoint(APPLIES[name]):
            kinds = " and ".join(sorted(read_as))
            raise ParameterError(
                f"{option}: is for {' and '.join(APPLIES[name])}, and has no effect on {kinds}"
            )


def samples(text: str | None) -> slice | None:
    """Return the samples FIRST:END that are held out."""
    if text is None:
        return None
    first, colon, end = text.partition(":")
    if not (colon and first.isdecimal() and end.isdecimal() and int(first) < int(end)):
        raise ParameterError(f"--held-out {text}: expected FIRST:END in samples, such as 0:40000")
    return slice(int(first), int(end))
