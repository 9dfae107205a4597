"""Fits that a checkpoint keeps, by all that they depend on."""

import hashlib
from functools import partial

import numpy as np
from numpy.typing import NDArray

from femnl.core.checkpoint import Checkpoint
from femnl.core.readout import Array
from femnl.fits.minimise import minimise
from femnl.observe.extended import ExtendedModel


def recalled(
    model: ExtendedModel,
    start: Array,
    asked: tuple[NDArray[np.bool_] | None, int, float],
    first: Array,
    checkpoint: Checkpoint | None,
    known: Array | None = None,
) -> tuple[Array, Array]:
    """Return what the checkpoint keeps of a fit, or make it.

    asked: residuals to fit, most evaluations, and what χ² is worth them, see `fit`. first (p,):
    steps at the start. known (n, p): derivatives there, where they are known.
    """
    keep, most, worth = asked
    make = partial(minimise, model, start, keep, most, first, worth=worth, known=known)
    if checkpoint is None:
        return make()
    return checkpoint.recall(_key(model, start, asked, first, known is not None), make)


def _key(
    model: ExtendedModel,
    start: Array,
    asked: tuple[NDArray[np.bool_] | None, int, float],
    first: Array,
    slopes_known: bool,
) -> str:
    """Name a fit by all that it depends on beside the file.

    The first residuals are part of it, since a problem posed in two ways starts in two places.
    """
    keep, *ends = asked
    digest = hashlib.sha256(
        repr(
            (
                model.parameters,
                [effect.equation for effect in model.effects],
                model.base_model.variant,
                *ends,
                slopes_known,
            )
        ).encode()
    )
    for part in (
        start,
        first,
        model.residuals(start),
        model.base_model.start,
        *model.bounds,
        *([] if keep is None else [keep]),
    ):
        digest.update(np.ascontiguousarray(part).tobytes())
    return digest.hexdigest()
