"""The models of a response that evidence chooses from: background, delay, stiffening."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from femnl.core.choices import Background
from femnl.observe.response.theta import Layout

Delay = Literal["none", "all", "resonance"]
"""What a delay turns: nothing, resonance and background, or the resonance alone."""
TERMS: dict[Background, int] = {"none": 0, "constant": 1, "slope": 2}
"""Complex terms of each background."""
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Variant:
    """One model of a response.

    background: its form; driven: whether it is proportional to the drive; delay: what it turns;
    duffing: whether the frequency depends on the amplitude.
    """

    background: Background
    driven: bool
    delay: Delay
    duffing: bool

    def layout(self, like: Layout) -> Layout:
        """Return the layout of θ, the rest as in another."""
        return Layout(
            like.centre,
            like.width,
            like.span,
            like.reference,
            like.n_positions,
            like.damping,
            like.gain,
            like.phase,
            TERMS[self.background],
            self.driven,
            self.delay == "all",
        )

    def free(self, layout: Layout) -> Mask:
        """Return which parts of θ are fitted (size,)."""
        found = np.ones(layout.size, bool)
        found[2] = self.duffing
        if layout.phase:
            found[layout.delay] = self.delay != "none"
        return found

    def __str__(self) -> str:
        """Say it in words."""
        behind = {"none": "no background", "constant": "a constant background"}.get(
            self.background, "a sloping background"
        )
        behind += " proportional to the drive" if self.driven else ""
        late = {"none": "no delay", "all": "a delay"}.get(self.delay, "a delay of the resonance")
        return f"{behind}, {late}, {'a Duffing term' if self.duffing else 'linear'}"


def carried(theta: NDArray[np.float64], old: Layout, new: Layout) -> NDArray[np.float64]:
    """Return θ of another variant: what both have is kept, terms that only `new` has are 0."""
    found = np.zeros(new.size)
    found[: new.delay + int(new.phase)] = theta[: old.delay + int(old.phase)]
    terms = min(old.background, new.background)
    for p in range(new.n_positions):
        source = old.backgrounds.start + 2 * old.background * p
        target = new.backgrounds.start + 2 * new.background * p
        found[target : target + 2 * terms] = theta[source : source + 2 * terms]
    return found
