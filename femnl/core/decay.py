"""Decays as fits leave them: phases of the record, and the fit with what it was made to."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from femnl.core.arrays import freeze
from femnl.core.fit import Fit
from femnl.core.kinds import function
from femnl.core.tables import Table, Tabulated

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PhaseName = Literal[
    "before", "driven", "decay", "dropout", "floor", "other try", "left out", "not recorded"
]


@dataclass(frozen=True)
class Phase:
    """One phase of a record, from begin to end [s].

    before: nothing moves yet. driven: the mode rings up or is held. decay: what is fitted. dropout:
    an interruption of the decay, left out. floor: noise alone. other try: a second decay of the
    same rate. left out: neither. not recorded: the smooth rest that an analyser draws.
    """

    name: PhaseName
    begin: float
    end: float


@dataclass(frozen=True)
class DecayFit(Tabulated):
    """The fit of one record of a decay.

    time (n,) [s], power (n,) [dB]: the record. used (n,): what was fitted. mean (n,) [dB]: signal
    and noise as fitted, NaN outside of the decay and its floor. residual (n,): normal scores of the
    data under the fitted distribution, NaN where not used. correlation: time over which the noise
    is correlated, in points of the record.
    """

    fit: Fit
    phases: tuple[Phase, ...]
    time: NDArray[np.float64]
    power: NDArray[np.float64]
    used: NDArray[np.bool_]
    mean: NDArray[np.float64]
    residual: NDArray[np.float64]
    correlation: float

    def __post_init__(self) -> None:
        freeze(self)

    def __repr__(self) -> str:
        """The fit, and the phases."""
        found = ", ".join(f"{p.name} {p.begin:.4g} … {p.end:.4g} s" for p in self.phases)
        return f"<DecayFit: {self.fit!r}; {found}>"

    def __getitem__(self, name: str) -> float:
        """Return the value of the parameter called `name`."""
        return self.fit[name]

    def plot(self) -> "Figure":
        """Draw phases, fit, residual, and the quality factor against the power."""
        figure: Figure = function("femnl.plot.power_decay:decay_fit_figure")(self)
        return figure

    def _tables(self) -> list[Table]:
        columns: dict[str, list[str]] = {
            "phase": [str(phase.name) for phase in self.phases],
            "from (s)": [f"{phase.begin:.4g}" for phase in self.phases],
            "to (s)": [f"{phase.end:.4g}" for phase in self.phases],
        }
        return [*self.fit._tables(), Table("Phases of the record", columns)]
