"""The covariance of a decay's blocks: the filter's noise and that of the readout, from the data."""

import hashlib
from dataclasses import astuple, dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky

from femnl.core.checkpoint import Checkpoint
from femnl.fits.decay.readout import ROUGH, Noisy, wander_of
from femnl.observe.decay.blocks import Blocks, Filter, Wander, Whitening, filtered, part_of, read

Array = NDArray[np.float64]
OWN = 0.01
"""Part of the standard deviation of a block's noise that no neighbour shares, at least."""
MEMORIES = np.geomspace(0.2, 20, 8)
"""Memories of a filter that are tried, in points."""
BEST = 2
"""Filters whose noise is sought thoroughly."""
STEEPNESS = (1.0, 2.0)
"""Powers of time in the filter's memory that are tried: a single pole, and a Gaussian filter."""


@dataclass(frozen=True, eq=False)
class Fluctuating:
    """What fluctuates: values (n_blocks,) of blocks of points (n,) at times [s].

    interval [s]: between points. share (n_blocks,): S/(S + N). read_share (n_blocks,): by which
    noise of the readout counts. averages of the filter's noise. strong (n_blocks,): blocks that
    tell the noise; late (n_blocks,): those of the floor.
    """

    blocks: Blocks
    time: Array
    interval: float
    values: Array
    share: Array
    read_share: Array
    averages: float
    strong: NDArray[np.bool_]
    late: NDArray[np.bool_]


def fluctuation(one: Fluctuating, checkpoint: Checkpoint | None) -> tuple[Array, Wander]:
    """Return the covariance (n_blocks, n_blocks), and the noise of the readout in it.

    Of the filters that are tried, the one that makes the data likeliest. checkpoint: keeps what was
    found, as a diagnosis poses the same record several times.
    """

    def find() -> tuple[Array, Array]:
        matrix, wander = _likeliest(one)
        return matrix, np.array(astuple(wander))

    if checkpoint is None:
        matrix, wander = find()
    else:
        matrix, wander = checkpoint.recall(f"noise of a decay {_digest(one)}", find)
    return matrix, Wander(*wander.tolist())


def _likeliest(one: Fluctuating) -> tuple[Array, Wander]:
    """Return covariance and noise of the readout with the likeliest filter."""
    tried = []
    for memory, steepness in product(one.interval * MEMORIES, STEEPNESS):
        filter_ = Filter(float(memory), steepness, one.averages)
        behind = filtered(one.blocks, one.time, one.share, filter_)
        tried.append((wander_of(_told(one, behind), ROUGH)[1], behind))
    tried.sort(key=lambda found: found[0])
    best = [(*wander_of(_told(one, behind)), behind) for _, behind in tried[:BEST]]
    wander, _, behind = min(best, key=lambda found: found[1])
    return wander.filtered * behind + read(one.blocks, one.read_share, wander), wander


def _told(one: Fluctuating, behind: Array) -> Noisy:
    """Return the blocks that tell the noise, for a covariance (n_blocks, n_blocks) by a filter."""
    told = one.strong
    part = part_of(one.blocks, told)
    inside = behind[np.ix_(told, told)]
    return Noisy(part, one.values[told], inside, one.read_share[told], one.late[told])


def _digest(one: Fluctuating) -> str:
    """Return a digest of all that the noise depends on."""
    digest = hashlib.sha256(repr((one.interval, one.averages, one.blocks.width)).encode())
    for values in (one.time, one.values, one.share, one.read_share, one.strong, one.late):
        digest.update(np.ascontiguousarray(values).tobytes())
    return digest.hexdigest()


def whitening(noise: Array) -> Whitening:
    """Return what whitens noise of a covariance (n, n).

    Of a readout that wanders much more than it scatters, the covariance, which is known to a part
    in a million, may be indefinite; each block gets a scatter of its own as well.
    """
    own = np.diag(np.diag(noise)) * OWN**2
    return Whitening(cholesky(noise + own, lower=True))
