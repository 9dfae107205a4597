"""What a device deviates by from its chip, and why."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import logsumexp

from femnl.chip.outliers import Cleaned, log_anywhere
from femnl.chip.result import Cause, Deviation, Quantity
from femnl.chip.words import signed_percent

if TYPE_CHECKING:
    from femnl.chip.fit import Entries

MISLABELLED_PRIOR = 0.2
"""Prior probability that a device with an odd frequency is one of another design of the chip: of
five odd devices, one is mixed up and four are damaged or of another film."""


def name_causes(
    entries: Entries, cleaned: Cleaned, frequency: Quantity, quality: Quantity | None
) -> tuple[Cause, ...]:
    """Return a cause for every device that is an outlier in frequency or quality factor."""
    found = []
    rated = {} if quality is None else _strongest(quality)
    shifted = _strongest(frequency)
    for name, shift in shifted.items():
        loss = rated.get(name)
        odd_loss = loss is not None and loss.odd
        if shift.odd:
            found.append(_shifted(entries, cleaned, shift, loss if odd_loss else None))
        elif loss is not None and odd_loss:
            found.append(_lossy(loss))
    return tuple(found)


def _strongest(quantity: Quantity) -> dict[str, Deviation]:
    """Return of each device the mode that deviates most."""
    found: dict[str, Deviation] = {}
    for one in quantity.devices:
        if one.device not in found or abs(one.sigma) > abs(found[one.device].sigma):
            found[one.device] = one
    return found


def _shifted(entries: Entries, cleaned: Cleaned, shift: Deviation, loss: Deviation | None) -> Cause:
    """Return why a frequency is odd: another design's, or a device of its own."""
    swapped, probability = _other_design(entries, cleaned, shift.device)
    part = signed_percent(shift.log_ratio)
    beside = f"; it {_loses(loss)}" if loss is not None else ""
    if probability > 0.5:
        words = (
            f"its frequency is {part} off design {shift.design}, and that of design {swapped} at "
            f"its place: names or designs are mixed up{beside}"
        )
        return Cause(shift.device, "mislabelled", probability * shift.outlier, words)
    name = "damaged" if loss is not None and loss.log_ratio < 0 else "other film or shape"
    sigma = f"{shift.sigma:+.1f}σ".replace("-", "−")
    words = f"its frequency is {part} off its chip ({sigma}){beside}"
    return Cause(shift.device, name, (1 - probability) * shift.outlier, words)


def _other_design(entries: Entries, cleaned: Cleaned, device: str) -> tuple[str, float]:
    """Return the design whose frequencies a device has, and the probability that it is of it.

    The alternative is that its frequencies may lie anywhere near those of its own design.
    """
    own = np.array([member.name == device for member, _ in entries.rows])
    values = entries.values.only(own)
    modes = [mode for member, mode in entries.rows if member.name == device]
    design = next(member.design for member, _ in entries.rows if member.name == device)
    model = cleaned.model
    log_odds = {design: np.log1p(-MISLABELLED_PRIOR) + log_anywhere(model, values)}
    others = sorted({d for d, _ in entries.groups if d != design})
    for other in others:
        groups = [
            entries.groups.index((other, mode)) if (other, mode) in entries.groups else -1
            for mode in modes
        ]
        if any(group not in model.values.groups for group in groups):
            continue
        there = replace(values, group=np.array(groups))
        log_density = model.log_density(there)
        log_odds[other] = np.log(MISLABELLED_PRIOR / len(others)) + log_density
    total = logsumexp([*log_odds.values()])
    best = max(log_odds, key=lambda name: log_odds[name])
    return best, 0.0 if best == design else float(np.exp(log_odds[best] - total))


def _lossy(loss: Deviation) -> Cause:
    """Return why a quality factor is odd where the frequency is not."""
    name = "lossy" if loss.log_ratio < 0 else "loses less"
    words = f"it {_loses(loss)}, and its frequency is the chip's"
    return Cause(loss.device, name, loss.outlier, words)


def _loses(loss: Deviation) -> str:
    factor = np.exp(abs(loss.log_ratio))
    return f"loses {factor:.3g} times {'more' if loss.log_ratio < 0 else 'less'} than its chip"
