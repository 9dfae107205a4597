"""Starts of a linear resonance on a background: projection on a grid of f₀, w and delay."""

import numpy as np
from numpy.typing import NDArray

from femnl.observe.response.sweeps import Array, Complex, Sweeps
from femnl.observe.response.theta import Layout

DELAYS = np.linspace(-4, 4, 65)
"""Delays tried, in units of 1/span."""
RATIO = 1.6
"""Between neighbouring widths tried."""
STEPS = 0.5
"""Linewidths between neighbouring frequencies tried."""
WIDEST = 3.0
"""Spans of the widest line tried."""
NARROWEST = 0.7
"""Spacings of points of the narrowest."""
FULL = 64
"""Widths in the span up to which every place is tried, beyond it only where the signal changes."""
PLACES = 24
"""Places of the fastest change that are tried for narrow lines."""
OUTSIDE = 0.25
"""Spans outside of the data where a wide line may lie."""
MOST = 3_000
"""Points used at most."""
TRIED = 3
"""Starts handed on."""
CHUNK = 2_000_000
TINY = np.finfo(float).tiny


def linear_starts(sweeps: Sweeps, layout: Layout, *, late: bool) -> list[Array]:
    """Return the starts θ of a linear resonance that leave the least, the best first.

    V = drive·A L(f; f₀, w) + background, each turned by the delay as the layout says, is linear in
    A and the background once f₀, w and the delay are chosen: what one takes up is a projection.

    Args: late: whether a delay is tried.
    """
    kept = _thinned(sweeps)
    f = sweeps.frequency[kept]
    places, widths = _grid(sweeps, f)
    delays = DELAYS / layout.span if late else np.zeros(1)
    gain = np.zeros((len(places), len(delays)))
    for p in range(sweeps.n_positions):
        at = kept[sweeps.position[kept] == p]
        for part in _chunks(len(places), len(at)):
            gain[part] += _taken(sweeps, layout, at, places[part], widths[part], delays)
    found: list[Array] = []
    order = np.argsort(gain, axis=None)[::-1]
    chosen: list[tuple[float, float, float]] = []
    for index in order[:400]:
        row, column = np.unravel_index(index, gain.shape)
        here = (float(places[row]), float(widths[row]), float(delays[column]))
        if any(_alike(here, other, layout.span) for other in chosen):
            continue
        chosen.append(here)
        found.append(_theta(sweeps, layout, *here))
        if len(found) == TRIED:
            break
    return found


def single_starts(f: Array, volts: Complex) -> list[tuple[float, float]]:
    """Return frequencies and linewidths [Hz] of one line on a sloping background, the best first.

    Args: f (n,) rising [Hz]; volts (n,) [V].
    """
    count = len(f)
    zeros = np.zeros(count, np.intp)
    one = Sweeps(
        f,
        volts,
        np.ones(count),
        zeros,
        zeros,
        zeros,
        np.arange(count),
        (slice(0, count),),
        (0,),
        np.zeros((1, 2)),
        1.0,
        1.0,
        (),
    )
    middle = float(f.mean())
    layout = Layout(middle, one.span / 10, one.span, 1.0, 1, False, True, True, 2)
    found = [layout.split(theta) for theta in linear_starts(one, layout, late=False)]
    return [(f0, w) for f0, w, *_ in found]


def _alike(one: tuple[float, float, float], other: tuple[float, float, float], span: float) -> bool:
    """Whether two choices lead to one minimum."""
    return (
        abs(one[0] - other[0]) < max(one[1], other[1])
        and abs(np.log(one[1] / other[1])) < 1
        and abs(one[2] - other[2]) * span < 0.3
    )


def _thinned(sweeps: Sweeps) -> NDArray[np.intp]:
    """Return at most MOST of the points, evenly."""
    count = len(sweeps.frequency)
    return np.arange(count)[:: max(1, -(-count // MOST))]


def _chunks(rows: int, points: int) -> list[slice]:
    step = max(1, CHUNK // max(points, 1))
    return [slice(start, start + step) for start in range(0, rows, step)]


def _grid(sweeps: Sweeps, f: Array) -> tuple[Array, Array]:
    """Return frequencies and linewidths [Hz] to try, flat."""
    low = float(f.min())
    span = float(np.ptp(f))
    longest = max(s.stop - s.start for s in sweeps.spans)
    spacing = span / max(longest - 1, 1)
    fast = _fast_places(sweeps)
    places: list[Array] = []
    widths: list[Array] = []
    width = WIDEST * span
    while width > NARROWEST * spacing:
        if span / width <= FULL:
            margin = OUTSIDE * span if width > span / 8 else 0.0
            count = max(9, round((span + 2 * margin) / (STEPS * width)))
            here = np.linspace(low - margin, low + span + margin, count)
        else:
            steps = np.arange(-2, 3) * STEPS * width
            here = (fast[:, None] + steps).ravel()
        here = here[here > 0.05 * low]
        places.append(here)
        widths.append(np.full(len(here), width))
        width /= RATIO
    return np.concatenate(places), np.concatenate(widths)


def _fast_places(sweeps: Sweeps) -> Array:
    """Return the frequencies [Hz] at which neighbouring points differ most."""
    places: list[Array] = []
    change: list[Array] = []
    for span in sweeps.spans:
        v = sweeps.voltage[span] / sweeps.drive[span]
        f = sweeps.frequency[span]
        places.append((f[1:] + f[:-1]) / 2)
        change.append(np.abs(np.diff(v)))
    size = np.concatenate(change)
    return np.concatenate(places)[np.argsort(size)[::-1][:PLACES]]


def _shape(f: Array, places: Array, widths: Array) -> Complex:
    """Return f₀ w/(f₀² − f² + i f w), (rows, points)."""
    here = places[:, None]
    width = widths[:, None]
    return np.asarray(here * width / ((here - f) * (here + f) + 1j * f * width))


def _behind(sweeps: Sweeps, layout: Layout, at: NDArray[np.intp], middle: float) -> Array:
    """Return the columns of the background at some points, (n, terms)."""
    away = (sweeps.frequency[at] - middle) / layout.span
    columns = np.stack([np.ones_like(away), away], axis=1)[:, : layout.background]
    return np.asarray(columns * (sweeps.drive[at, None] if layout.driven else 1.0))


def _taken(
    sweeps: Sweeps,
    layout: Layout,
    at: NDArray[np.intp],
    places: Array,
    widths: Array,
    delays: Array,
) -> Array:
    """Return what each choice takes up of |V|² at one position, (rows, delays)."""
    f = sweeps.frequency[at]
    lines = sweeps.drive[at] * _shape(f, places, widths)
    turn = np.exp(2j * np.pi * (f - layout.centre)[:, None] * delays)
    basis, _ = np.linalg.qr(_behind(sweeps, layout, at, layout.centre))
    v = sweeps.voltage[at]
    power = np.sum(np.abs(lines) ** 2, axis=1)[:, None]
    if layout.delayed:
        turned = v[:, None] * turn
        inside = basis.T @ turned
        rest = turned - basis @ inside
        behind = np.sum(np.abs(inside) ** 2, axis=0)
        lost = np.sum(np.abs(lines @ basis) ** 2, axis=1)[:, None]
    else:
        inside = basis.T @ v
        rest = (v - basis @ inside)[:, None] * turn
        behind = np.full(len(delays), np.sum(np.abs(inside) ** 2))
        lost = np.zeros((len(places), len(delays)))
        for k in range(basis.shape[1]):
            lost += np.abs(lines.conj() @ (basis[:, k, None] * turn)) ** 2
    overlap = np.abs(lines.conj() @ rest) ** 2
    left = np.maximum(power - lost, 1e-9 * power)
    return np.asarray(overlap / left + behind)


def _theta(sweeps: Sweeps, layout: Layout, f0: float, w: float, tau: float) -> Array:
    """Return θ with gains, phases and backgrounds by linear least squares."""
    theta = np.zeros(layout.size)
    theta[0] = (f0 - layout.centre) / layout.width
    theta[1] = np.log(w / layout.width)
    theta[layout.delay] = tau * layout.span
    for p in range(sweeps.n_positions):
        at = np.flatnonzero(sweeps.position == p)
        f = sweeps.frequency[at]
        line = sweeps.drive[at] * _shape(f, np.array([f0]), np.array([w]))[0]
        turn = np.exp(-2j * np.pi * (f - f0) * tau)
        behind = _behind(sweeps, layout, at, f0) * (turn[:, None] if layout.delayed else 1.0)
        columns = np.column_stack([line * turn, behind])
        scale = np.linalg.norm(columns, axis=0) + TINY
        found = np.linalg.lstsq(columns / scale, sweeps.voltage[at], rcond=1e-9)[0] / scale
        theta[layout.gains.start + p] = np.log(max(abs(found[0]), TINY))
        theta[layout.phases.start + p] = np.angle(found[0])
        start = layout.backgrounds.start + 2 * layout.background * p
        theta[start : start + 2 * layout.background : 2] = found[1:].real
        theta[start + 1 : start + 2 * layout.background : 2] = found[1:].imag
    return theta
