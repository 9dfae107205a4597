"""Numbers as a reader wants them: as many digits as the error leaves."""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from math import floor, inf, isfinite, log10

MINUS = str.maketrans("-", "−")
PREFIXES = {
    -6: "a",
    -5: "f",
    -4: "p",
    -3: "n",
    -2: "µ",
    -1: "m",
    0: "",
    1: "k",
    2: "M",
    3: "G",
    4: "T",
}
UNIT = re.compile(r"(Hz|Pa|kg(?!/)|rad|[mVsKNW])(?:\^([23]))?(/.*)?")
"""Units whose first symbol takes a prefix, its power, and the rest."""
NO_MULTIPLES = ("s", "rad")
"""Symbols that nobody writes with kilo."""
SMALL = 1e-3
"""Numbers without unit count in ppm below this."""
SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def plain(value: float, digits: int = 7) -> str:
    """Return a number with so many significant digits, powers of ten written out: 8.7·10⁻⁷."""
    text = f"{value:.{digits}g}"
    if "e" in text:
        mantissa, exponent = text.split("e")
        text = f"{mantissa}·10{str(int(exponent)).translate(SUPERSCRIPT)}"
    return text.replace("-", "−")


@dataclass(frozen=True)
class Scale:
    """A unit of readable size: how much of the SI unit it is, and how it is written."""

    size: float
    unit: str


def scale_for(value: float, unit: str) -> Scale:
    """Return the unit in which a value [unit] has few digits: 3.97e-7 m are 397 nm.

    Masses count in grams, and small numbers without unit in ppm. A unit that begins with a power,
    as 1/V does, stays as it is: its prefixes are harder to read than a power of ten.

    Args: unit: in SI, as files write it: "m", "m^3", "V/m", "" or "1" for none.
    """
    parts = UNIT.fullmatch(unit)
    large = abs(value) if isfinite(value) else 0.0
    if unit in ("", "1"):
        return Scale(1e-6, "ppm") if 0 < large < SMALL else Scale(1.0, "")
    if large == 0 or parts is None:
        return Scale(1.0, _superscript(unit))
    symbol = "g" if unit == "kg" else parts[1]
    one = 1e-3 if unit == "kg" else 1.0
    power = int(parts[2] or 1)
    rest = _superscript(parts[3] or "")
    decades = log10(large / one) / (3 * power)
    exponent = floor(decades + 1e-12) if power == 1 else round(decades)
    exponent = min(max(exponent, min(PREFIXES)), 0 if symbol in NO_MULTIPLES else max(PREFIXES))
    raised = "" if power == 1 else str(power).translate(SUPERSCRIPT)
    return Scale(one * 1000.0 ** (exponent * power), f"{PREFIXES[exponent]}{symbol}{raised}{rest}")


def engineering(value: float, unit: str) -> str:
    """Return a value to three digits in a readable unit, such as 480 Hz or 73 kHz."""
    scale = scale_for(value, unit)
    return f"{plain(value / scale.size, 3)} {scale.unit}".strip()


def signed(value: float, unit: str) -> str:
    """Return a value as `engineering` does, with its sign."""
    return ("" if value < 0 else "+") + engineering(value, unit)


def _superscript(unit: str) -> str:
    """Return a unit with its powers set high: m^-2 is m⁻²."""
    return re.sub(r"\^(-?\d+)", lambda power: power[1].translate(SUPERSCRIPT), unit)


def with_error(value: float, error: float | None, digits: int = 1) -> str:
    """Return a number and its error to so many digits, to the same decimal: 1.581372 ± 0.000002.

    Without a finite error the number stands alone.
    """
    if error is None or not isfinite(error) or error <= 0 or not isfinite(value):
        return plain(value)
    decimals = digits - 1 - floor(log10(error) + 1e-9)
    power = floor(log10(max(abs(value), error)))
    if power and not (0 <= decimals <= 12 and (value == 0 or abs(value) >= 1e-3)):
        mantissa = with_error(value / 10.0**power, error / 10.0**power, digits)
        return f"({mantissa})·10{str(power).translate(SUPERSCRIPT)}"
    if decimals > 12:
        return plain(value, 13)
    decimals = max(decimals, 0)
    return f"{value:.{decimals}f} ± {error:.{decimals}f}".translate(MINUS)


def measured(values: Iterable[float], sd: Iterable[float]) -> list[str]:
    """Numbers with their standard deviations to two digits, unknown where those are not finite."""
    return [
        with_error(value, s, 2) if isfinite(s) else f"{plain(value)} ± unknown"
        for value, s in zip(values, sd, strict=True)
    ]


def micrometres(length: float) -> str:
    """Return a length [m] in µm to the nanometre; rounding of a length of zero is not shown."""
    return plain(round(length * 1e6, 3) + 0.0)


def ppm(value: float, reference: float) -> str:
    """Return the relative difference in ppm, or in % from 1 % on, with its sign."""
    part = value / reference - 1 if reference else inf
    return (
        f"{part:+.2%}".replace("%", " %") if abs(part) >= 1e-2 else f"{part * 1e6:+,.4g} ppm"
    ).translate(MINUS)
