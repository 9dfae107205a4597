"""The global part of a map fit.

Every amplitude on a grid, with contrast, working point and phase of motion eliminated at each.

The misfit has a minimum for about every fringe that the motion crosses, so no local search is safe.
At a given U the model is linear in the contrast; what the data say about (θ, φ) is held by the sums
Σ J_n(kqUξ) V_n and Σ J_n(kqUξ) J_n(lqUξ) over the map.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.special import jv

from femnl.core.readout import Array, ComplexArray
from femnl.observe.map.forward import MapData, Shape, locate
from femnl.optics.unit_fringe import overtone_weights

BINS = 401
"""Classes of ξ from −1 to 1 into which the points are gathered."""
STEP = 0.15
"""Step of the grid in z = qU; J_n(z) turns over in about 3."""
LARGEST = 30.0
"""Largest z of the grid: beyond, rings would be narrower than the points of a usual map."""
OVERTONES = 4
"""Overtones of the fringe that the coarse search keeps."""


@dataclass(frozen=True)
class Start:
    """A starting point of the refinement: the amplitude [m], and per map its other parameters.

    Gain is the χ² that it explains.
    """

    amplitude: float
    maps: tuple[dict[str, float], ...]
    gain: float


def starts(
    maps: list[MapData],
    shape: Shape,
    count: int,
    placements: list[list[dict[str, float]]],
    amplitude: float | None = None,
) -> list[Start]:
    """Return the `count` best local optima in U, best first.

    Args:
        maps: the maps, which share U.
        shape: ξ.
        count: most starts to return.
        placements: for each map the placements (x, y, scale, rotation) to try.
        amplitude: U [m] where it is known; sought on the grid unless given.
    """
    if amplitude is None:
        steepest = max(data.wavenumber for data in maps)
        z = STEP * (np.arange(round(LARGEST / STEP)) + 0.5)
        amplitudes = np.asarray(z / steepest, np.float64)
    else:
        amplitudes = np.array([abs(amplitude)])
    total = np.zeros(len(amplitudes))
    winners: list[list[tuple[dict[str, float], Array]]] = []
    for data, tried in zip(maps, placements, strict=True):
        tables = np.stack(_explained(data, shape, tried, amplitudes))
        gain = tables[..., 0]
        best = np.argmax(gain, axis=0)
        winners.append([(tried[b], tables[b, i]) for i, b in enumerate(best)])
        total += gain.max(axis=0)
    return [
        Start(
            float(amplitudes[i]), tuple(_parameters(*rows[i]) for rows in winners), float(total[i])
        )
        for i in _highest_peaks(total, count)
    ]


def _highest_peaks(gain: Array, count: int) -> NDArray[np.intp]:
    """Return where the gain (n,) has its `count` highest local maxima, the highest first."""
    padded = np.concatenate([[-np.inf], gain, [-np.inf]])
    peaks = np.flatnonzero((gain >= padded[:-2]) & (gain > padded[2:]))
    return np.asarray(peaks[np.argsort(-gain[peaks])][:count])


def _parameters(placement: dict[str, float], row: Array) -> dict[str, float]:
    """Return the placement with the parameters in a row of `_explained`."""
    return {
        **placement,
        "contrast": float(row[1]),
        "fringe_phase": float(row[2]),
        "motion_phase": float(row[3]),
    }


def _explained(
    data: MapData, shape: Shape, placements: list[dict[str, float]], amplitudes: Array
) -> list[Array]:
    """Return the χ² that the best (V_C, θ, φ) explains for each placement and U, and these values.

    There is one array (n_amplitudes, 4) for each placement, of χ², V_C, θ and φ.
    """
    # For one cosine, θ + π is −V_C, which the linear step finds by itself.
    theta = np.arange(0, np.pi if len(data.series.coefficients) == 2 else 2 * np.pi, np.pi / 32)
    phi = np.arange(0, 2 * np.pi, np.pi / (4 * data.harmonic.max()))
    weight = overtone_weights(data.series, data.harmonic, theta)[0][..., :OVERTONES]
    turn = np.exp(-1j * data.harmonic[:, None] * phi)
    bessel = _bessel(
        tuple(data.harmonic.tolist()),
        weight.shape[-1],
        round(data.wavenumber * amplitudes[0] / (STEP / 2), 6),
        len(amplitudes),
    )
    tables = []
    for placement in placements:
        moments, counts = _gather(data, shape(*locate(data, **placement)))
        sums = np.einsum("unkb,nb->unk", bessel, moments)
        products = (bessel * counts[:, None, :]) @ np.swapaxes(bessel, -1, -2)
        overlap = np.einsum("tnk,unk->utn", weight, sums)
        norm = np.einsum("tnk,tnl,unkl->ut", weight, weight, products, optimize=True)
        met = (overlap @ turn).real
        gain = np.divide(met**2, norm[..., None], out=np.zeros_like(met), where=norm[..., None] > 0)
        best = np.argmax(gain.reshape(len(amplitudes), -1), axis=1)
        t, p = np.unravel_index(best, (len(theta), len(phi)))
        row = np.arange(len(amplitudes))
        contrast = met[row, t, p] / np.maximum(norm[row, t], np.finfo(float).tiny)
        tables.append(
            np.column_stack([gain[row, t, p] / data.noise**2, contrast, theta[t], phi[p]])
        )
    return tables


@lru_cache(maxsize=4)
def _bessel(harmonic: tuple[int, ...], n_overtones: int, ratio: float, n_amplitudes: int) -> Array:
    """Return J_n(k·ratio·zξ) over the grid of z and the classes of ξ.

    (n_amplitudes, n_harmonics, n_overtones, BINS).
    """
    n = np.array(harmonic)[:, None, None]
    z = ratio * STEP * (np.arange(n_amplitudes) + 0.5)
    right = jv(
        n,
        np.arange(1, n_overtones + 1)[:, None]
        * z[:, None, None, None]
        * np.linspace(0, 1, BINS // 2 + 1),
    )
    return np.concatenate([(-1.0) ** n * right[..., :0:-1], right], axis=-1)


def _gather(data: MapData, xi: Array) -> tuple[ComplexArray, Array]:
    """Return the sums of V_n and of ones over classes of ξ.

    Each point is shared linearly between the two nearest classes.
    """
    position = (np.clip(xi, -1, 1) + 1) * (BINS - 1) / 2
    left = np.minimum(position.astype(int), BINS - 2)
    share = position - left
    point = np.arange(xi.size)
    spread = csr_array(
        (np.concatenate([1 - share, share]), (np.concatenate([left, left + 1]), np.tile(point, 2))),
        shape=(BINS, xi.size),
    )
    return np.asarray(spread @ data.values.T).T, np.asarray(spread @ data.present.T.astype(float)).T
