"""Values as JSON has them."""

import math
from typing import Any


def json_value(value: Any) -> Any:
    """Return a value for `json.dumps`: arrays as lists, NaN and infinities as null.

    JSON has no NaN (RFC 8259, section 6), and strict readers refuse a file that holds one.
    """
    if isinstance(value, dict):
        return {key: json_value(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [json_value(item) for item in value]
    if hasattr(value, "tolist"):
        return json_value(value.tolist())
    return None if isinstance(value, float) and not math.isfinite(value) else value
