"""Regimes: what is not ideal in a file, and the options that are drawn for each file of one."""

from dataclasses import dataclass, field

import numpy as np

Range = tuple[float, float]
STRENGTH: Range = (3.0, 1e4)
"""σ by which a cause stands out, as `bench.sizes` measures them, of the noise that there is."""


@dataclass(frozen=True)
class Regime:
    """What the files of a regime are drawn from; a range that is None: not in this regime.

    Ranges are uniform in the logarithm, but `thickness`, `radius` and `corner`, which are uniform.

    deviation: what the cause's first law leaves of its second, in parts of the cause. unknown: size
    of what no library has, likewise. glitches: part of the data, and glitch_size: their σ.
    correlation: between neighbours. stated: standard deviation in the file over the true one.
    thickness, radius: relative error of the file's film and holes. corner: radius [m] of the film's
    corners, which the file has sharp. lacking: the library has not the cause.
    """

    name: str
    deviation: Range | None = None
    unknown: Range | None = None
    glitches: Range | None = None
    glitch_size: Range = (7.0, 1000.0)
    correlation: Range | None = None
    stated: Range | None = None
    thickness: Range = (0.0, 0.0)
    radius: Range = (0.0, 0.0)
    corner: Range = (0.0, 0.0)
    lacking: bool = False


@dataclass(frozen=True)
class Options:
    """What was drawn for one file; see `Regime`."""

    deviation: float = 0.0
    unknown: float = 0.0
    glitches: float = 0.0
    glitch_size: Range = field(default=(7.0, 1000.0))
    correlation: float = 0.0
    stated: float = 1.0
    thickness: float = 0.0
    radius: float = 0.0
    corner: float = 0.0


GLITCHES: Range = (5e-4, 1e-2)
CORRELATION: Range = (0.2, 0.8)
STATED: Range = (0.4, 2.5)
REGIMES = {
    regime.name: regime
    for regime in (
        Regime("exact"),
        Regime("inexact", deviation=(1e-3, 0.2)),
        Regime("beside unknown", unknown=(0.01, 0.5)),
        Regime("glitches", glitches=GLITCHES),
        Regime("correlated noise", correlation=CORRELATION),
        Regime("wrong sd", stated=STATED),
        Regime(
            "as fabricated",
            thickness=(-0.05, 0.05),
            radius=(-0.03, 0.03),
            corner=(0.0, 8e-6),
        ),
        Regime("lacking", lacking=True),
    )
}
ALONE = Regime("unknown alone", unknown=(30.0, 3000.0))
"""Nothing but what no library has, of so many σ; not part of the study of verdicts."""
QUIET = ("exact", "glitches", "correlated noise", "wrong sd", "as fabricated")
"""Regimes in which nothing is hidden in some files."""
MANY = ("response", "map", "trace", "record", "decay")
"""Kinds of a hundred data and more, of which one per cent or less can be glitches."""


def allowed(regime: str, kind: str) -> bool:
    """Whether there are files of a regime for a kind of measurement."""
    if kind == "decay" and regime == "wrong sd":
        # Its files state no noise
        return False
    return regime != "glitches" or kind in MANY


def drawn(regime: Regime, rng: np.random.Generator) -> Options:
    """Draw the options of a file; every regime takes the same numbers from the stream."""
    part = rng.uniform(size=8)

    def scale(between: Range | None, k: int, none: float) -> float:
        if between is None:
            return none
        low, high = np.log(between)
        return float(np.exp(low + part[k] * (high - low)))

    def even(between: Range, k: int) -> float:
        return between[0] + float(part[k]) * (between[1] - between[0])

    return Options(
        deviation=scale(regime.deviation, 0, 0.0),
        unknown=scale(regime.unknown, 1, 0.0),
        glitches=scale(regime.glitches, 2, 0.0),
        glitch_size=regime.glitch_size,
        correlation=scale(regime.correlation, 3, 0.0),
        stated=scale(regime.stated, 4, 1.0),
        thickness=even(regime.thickness, 5),
        radius=even(regime.radius, 6),
        corner=even(regime.corner, 7),
    )
