"""Numbers as a reader wants them: as many digits as the error leaves."""

from collections.abc import Iterable
from math import floor, inf, isfinite, log10

MINUS = str.maketrans("-", "−")
PREFIXES = {-5: "f", -4: "p", -3: "n", -2: "µ", -1: "m", 0: "", 1: "k", 2: "M", 3: "G", 4: "T"}
SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def plain(value: float, digits: int = 7) -> str:
    """A number with so many significant digits, powers of ten written out: 8.7·10⁻⁷."""
    text = f"{value:.{digits}g}"
    if "e" in text:
        mantissa, exponent = text.split("e")
        text = f"{mantissa}·10{str(int(exponent)).translate(SUPERSCRIPT)}"
    return text.replace("-", "−")


def engineering(value: float, unit: str) -> str:
    """A value to three digits with an SI prefix, such as 480 Hz or 73 kHz."""
    if value == 0 or not unit or not isfinite(value):
        return f"{plain(value, 3)} {unit}".strip()
    power = min(max(floor(log10(abs(value)) / 3), min(PREFIXES)), max(PREFIXES))
    return f"{plain(value / 1000.0**power, 3)} {PREFIXES[power]}{unit}"


def with_error(value: float, error: float | None, digits: int = 1) -> str:
    """A number and its error to so many digits, both to the same decimal: 1.581372 ± 0.000002.

    Without a finite error the number alone.
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
    """A length [m] in µm to the nanometre; rounding of a length of zero is not shown."""
    return plain(round(length * 1e6, 3) + 0.0)


def ppm(value: float, reference: float) -> str:
    """The relative difference in ppm, or in % from 1 % on, with its sign."""
    part = value / reference - 1 if reference else inf
    return (
        f"{part:+.2%}".replace("%", " %") if abs(part) >= 1e-2 else f"{part * 1e6:+,.4g} ppm"
    ).translate(MINUS)
