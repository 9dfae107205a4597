"""Labels "mode N": what an overview calls a mode that has no name of its own."""

import re

from femnl.core.errors import MeasurementError
from femnl.observe.film import SimulatedFilm

NUMBERED = re.compile(r"\(?mode (\d+)\)?")
"""N is the place of the mode in the simulated film, from 1."""


def numbered_mode(label: str, film: SimulatedFilm) -> int | None:
    """Return the mode, from 0, that a label "mode N" names; None for a label of another form.

    Raises: MeasurementError for a number that is none of the film's modes.
    """
    match = NUMBERED.fullmatch(label)
    if match is None:
        return None
    number = int(match[1])
    if not 1 <= number <= len(film.modes.label):
        raise MeasurementError(
            f"spectrum/label: {label!r} is none of the first {len(film.modes.label)} modes of "
            f"{film.model.name}; correct it"
        )
    return number - 1
