"""Read-only arrays for frozen dataclasses."""

from dataclasses import fields
from typing import Any

import numpy as np


def freeze(value: Any) -> None:
    """Replace every array field of the dataclass `value` by a read-only copy.

    Call it from `__post_init__`.
    """
    for field in fields(value):
        array = getattr(value, field.name)
        if isinstance(array, np.ndarray):
            copy = array.copy()
            copy.flags.writeable = False
            object.__setattr__(value, field.name, copy)
