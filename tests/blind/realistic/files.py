"""One file of the realistic regime: made from a seed, with what is true of it beside."""

import re
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from femnl.io import measurement
from tests.blind.lab import KINDS
from tests.blind.lab.bench import Array, Bench, Values, sized
from tests.blind.lab.film import device
from tests.blind.lab.maps import SPOT, MapBench
from tests.blind.realistic.noise import RealNoise
from tests.blind.realistic.regimes import ALONE, REGIMES, STRENGTH, Options, drawn
from tests.blind.realistic.truth import Hidden, bent, excess, residual, shares
from tests.blind.realistic.unknown import SIGNALS, flat

COARSE_SPOT = np.linspace(-3.0, 3.0, 7)
"""Points of a laser spot along each axis, of which sizes are found; data have those of `SPOT`."""
CORNERED = ("square-270um", "rectangle")
"""Films whose corners the laboratory can round."""


@dataclass(frozen=True)
class Draw:
    """One file to make: kind, causes, regime, device, and the seed of all else."""

    kind: str
    causes: tuple[str, ...]
    regime: str
    geometry: str
    seed: int

    @property
    def name(self) -> str:
        """What tells the file from all others."""
        return f"{self.kind} {self.geometry} {'+'.join(self.causes)} {self.regime} {self.seed}"


@dataclass(frozen=True)
class Film:
    """A film on the bench: the true base and causes, and what is in its data beside."""

    bench: Any
    base: Values
    hidden: Hidden
    beside: Hidden
    more: Array | None
    flat: Array | float
    options: Options
    sigma: Values


def prepared(draw: Draw) -> Film:
    """Draw all of a file but its noise."""
    regime = ALONE if draw.regime == ALONE.name else REGIMES[draw.regime]
    rng = np.random.default_rng([draw.seed, *draw.kind.encode()])
    options = drawn(regime, rng)
    bench: Bench = KINDS[draw.kind].setup(draw.geometry, draw.causes, rng)
    if isinstance(bench, MapBench):
        bench.spot = COARSE_SPOT
    base = bench.draw(rng)
    drawn_causes = {name: KINDS[draw.kind].CAUSES[name](rng, bench) for name in draw.causes}
    # The noise that there is is that of the file over `stated`
    wanted = {
        name: float(np.exp(rng.uniform(*np.log(STRENGTH)))) / options.stated for name in draw.causes
    }
    sigma: Values = {}
    if draw.causes:
        drawn_causes, sigma = sized(bench, base, drawn_causes, wanted)
    hidden = {name: cause.values for name, cause in drawn_causes.items()}
    if options.deviation and hidden:
        hidden = bent(bench, base, hidden, options.deviation)
    beside: Hidden = {}
    if options.corner and draw.kind == "spectrum" and draw.geometry in CORNERED:
        beside = {"rounded_corners": {"radius": options.corner}}
    more, signal = None, 0.0
    if options.unknown and (hidden or regime is ALONE):
        more, signal = _unknown(draw, bench, base, hidden, options, rng)
    sigma = {name: size * options.stated for name, size in sigma.items()}
    return Film(bench, base, hidden, beside, more, signal, options, sigma)


def _unknown(
    draw: Draw, bench: Any, base: Values, hidden: Hidden, options: Options, rng: np.random.Generator
) -> tuple[Array, Any]:
    """Return what is unknown as noise and as data, of the wanted size.

    That counts beside what base and cause take up of it, in parts of the cause, or in σ where there
    is none.
    """
    signal = SIGNALS[draw.kind](bench, rng)
    count = bench.clean([(base, hidden)]).shape[1]
    whole = flat(draw.kind, signal, count)
    _, off = residual(bench, base, hidden, tuple(hidden), steps=0)
    size = float(np.linalg.norm(off(whole)))
    wanted = options.unknown
    if hidden:
        wanted *= float(np.sqrt(excess(bench, base, hidden, (), steps=0)))
    factor = wanted / size
    return signal * factor, whole * factor


def make(draw: Draw, path: Path) -> dict[str, Any]:
    """Write a file and return what is true of it."""
    film = prepared(draw)
    bench = film.bench
    # A stream of its own: the same device under other noise
    apart = hasattr(bench, "unknown")
    if apart and film.more is not None:
        bench.unknown = film.more
    stream = np.random.default_rng([draw.seed, 1, *b"noise"])
    noise = RealNoise(draw.kind, film.options, stream, None if apart else film.more)
    if hasattr(bench, "rating"):
        bench.rating = noise
    data = film.hidden | film.beside
    names = tuple(film.hidden)
    share = shares(bench, film.base, data, names, film.flat) if names else {}
    if isinstance(bench, MapBench):
        bench.spot = SPOT
    groups = bench.measured(film.base, data, noise)
    text = fabricated(device(draw.geometry).text, film.options)
    measurement.write(measurement.bundle(groups, geometry=draw.geometry, model=text), path)
    return {
        "draw": asdict(draw),
        "options": asdict(film.options),
        "base": film.base,
        "causes": film.hidden,
        "sigma": film.sigma,
        "shares": share,
        "glitches": noise.glitches,
    }


def fabricated(text: str, options: Options) -> str:
    """Return a geometry file whose film and holes are off by the drawn parts."""

    def off(part: float, pattern: str, text: str) -> str:
        return re.sub(
            pattern, lambda m: f"{m.group(1)}{float(m.group(2)) * (1 + part):.6g}", text, count=1
        )

    text = off(options.thickness, r'(\nthickness = ")([0-9.]+)', text)
    return off(options.radius, r'(\nradius = ")([0-9.]+)', text)
