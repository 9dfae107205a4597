"""What a fit of a chip says, in rows of words for tables and pages."""

import numpy as np

from femnl.chip.result import ChipFit, Deviation, Quantity
from femnl.core.fit import Parameter
from femnl.core.numbers import Scale, scale_for, with_error

CLEAR = 0.95
"""Probability from which on a form of the variation is called so."""
MOST_DECIMALS = 5
"""Decimals beyond which no number of a table goes."""
LEAST_TOLD = 1e-3
"""Probability below which a number is not told: the priors are not known that well."""


def common(quantity: Quantity, fit: ChipFit) -> list[list[str]]:
    """Return name and value of what the devices share."""
    rows = [["devices", str(len({d.device for d in quantity.devices}))]]
    rows += [
        [f"design {name.rsplit(' ', 1)[0]}, mode {name.rsplit(' ', 1)[1]}", _number(p, quantity)]
        for name, p in quantity.means.items()
    ]
    rows.append(["variation over the chip", variation(quantity)])
    if quantity.slope is not None and quantity.varies > CLEAR:
        per = "mm" if fit.place_unit == "m" else "step"
        factor = 1e-3 if fit.place_unit == "m" else 1.0
        rows += [
            [
                f"slope along {p.name}",
                f"{with_error(100 * factor * p.value, 100 * factor * p.sd, 2)} % a {per}",
            ]
            for p in quantity.slope
        ]
        told = {p.name for p in quantity.slope}
        rows += [
            [f"slope along {name}", f"not told, as all devices have the same {name}"]
            for name in "xy"
            if name not in told
        ]
        rows.append(["from lowest to highest device", f"{100 * quantity.peak_to_valley:.3g} %"])
    spread = quantity.spread
    rows.append(["from device to device", f"{percent(spread)}"])
    return rows


def _number(parameter: Parameter, quantity: Quantity) -> str:
    unit = "" if quantity.unit == "1" else f" {quantity.unit}"
    return f"{with_error(parameter.value, parameter.sd, 2)}{unit}"


def percent(part: Parameter) -> str:
    """Return a relative number and its error in per cent, without powers of ten."""
    error = 100 * part.sd
    decimals = int(np.clip(1 - np.floor(np.log10(error)), 0, MOST_DECIMALS)) if error > 0 else 2
    return f"{100 * part.value:.{decimals}f} ± {error:.{decimals}f} %"


def chance(probability: float) -> str:
    """Return a probability in per cent; what is below a thousandth, as that."""
    if probability < LEAST_TOLD:
        return f"< {100 * LEAST_TOLD:g} %"
    return f"{100 * probability:.3g} %"


def signed_percent(log_ratio: float) -> str:
    """Return by how much a value is off its prediction, of the logarithm of their ratio."""
    return f"{100 * np.expm1(log_ratio):+.3g} %".replace("-", "−")


def variation(quantity: Quantity) -> str:
    """Return which form the variation over the chip has, and how probable that is."""
    parts = ", ".join(f"{name} {chance(p)}" for name, p in quantity.fields.items())
    if quantity.varies > CLEAR:
        form = max(("plane", "bowl"), key=lambda name: quantity.fields[name])
        return f"{form} ({parts})"
    if len(quantity.fields) == 1:
        return "not sought without places"
    return f"none to speak of ({parts})"


def deviating(quantity: Quantity) -> list[list[str]]:
    """Return a row for every device and mode, those that deviate most first."""
    ordered = sorted(quantity.devices, key=lambda d: -abs(d.sigma))
    return [
        [
            d.device,
            d.mode,
            d.design,
            *_alike(d, quantity.unit),
            signed_percent(d.log_ratio),
            f"{d.sigma:+.1f}".replace("-", "−"),
            f"{d.outlier:.2f}" if d.outlier else "",
        ]
        for d in ordered
    ]


def _alike(device: Deviation, unit: str) -> tuple[str, str]:
    """Return value and prediction in one unit, to the digits in which they differ."""
    scale = scale_for(device.predicted, unit) if unit != "1" else Scale(1.0, "")
    apart = abs(device.value - device.predicted) / scale.size
    sd = apart / abs(device.sigma) if device.sigma else 0.0
    least = max(apart, sd) or 1.0
    whole = np.log10(max(device.predicted / scale.size, 1.0))
    decimals = int(np.clip(1 - np.floor(np.log10(least)), max(0, 2 - whole), MOST_DECIMALS))
    value, predicted = (
        f"{number / scale.size:.{decimals}f} {scale.unit}".strip()
        for number in (device.value, device.predicted)
    )
    return value, predicted


def left_out(quantity: Quantity) -> str:
    """Return how well devices are predicted by the others."""
    one = quantity.left_out
    if not one.count:
        return f"{quantity.name}: no device can be predicted by others of its design"
    return (
        f"{quantity.name} of a device left out: median error {100 * one.error:.3g} %, "
        f"{100 * one.plain_error:.3g} % by the mean of its design; "
        f"{100 * one.coverage:.0f} % of the 68 % intervals hold ({one.count} numbers)"
    )
