"""What each named cause changes of every datum, so that a reader can add it up.

The sum rule, datum by datum: data − idle model = Σ contributions + interaction + remainder.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray

from femnl.core.arrays import freeze
from femnl.core.comparison import Comparison
from femnl.core.errors import ParameterError
from femnl.core.kinds import function
from femnl.core.numbers import engineering, plain
from femnl.core.readout import Array
from femnl.core.tables import Columns, Table, Tabulated

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

Number = TypeVar("Number", np.float64, np.complex128)
IDLE = "no cause"
WHOLE = "all causes"
"""Names of the two models between which causes are counted."""


@dataclass(frozen=True)
class Term:
    """One part of the sum, at every datum (n,) of a quantity, in its unit.

    rms and largest (with its sign) are taken over the data that are no glitches. largest_sigma: the
    largest in standard deviations of its datum; where: the place of the largest.
    """

    name: str
    values: Array
    rms: float
    largest: float
    largest_sigma: float
    where: str

    def __post_init__(self) -> None:
        freeze(self)


@dataclass(frozen=True)
class Account:
    """The sum for all data (n,) of one quantity of one measurement.

    coordinates: of each datum, with SI units. sd (n,), as found, and all terms are in `unit`.
    excluded (n,): glitches, which no fit has seen. deviation: data − idle model. causes: what each
    contributes. interaction: what the causes change together beyond the sum of these. remainder:
    data − model with all causes.
    """

    measurement: str
    quantity: str
    unit: str
    coordinates: Columns
    sd: Array
    excluded: NDArray[np.bool_]
    deviation: Term
    causes: tuple[Term, ...]
    interaction: Term
    remainder: Term

    def __post_init__(self) -> None:
        freeze(self)

    @property
    def title(self) -> str:
        """Name the quantity, and the measurement where there are several."""
        return f"{self.measurement}: {self.quantity}" if self.measurement else self.quantity

    @property
    def terms(self) -> tuple[Term, ...]:
        """All terms, the deviation first, which is the sum of the others."""
        return (self.deviation, *self.causes, self.interaction, self.remainder)

    @property
    def interaction_part(self) -> float:
        """The largest interaction, as part of the largest change by all causes together."""
        change = np.abs(self.deviation.values - self.remainder.values)[~self.excluded]
        whole = float(change.max(initial=0.0))
        return abs(self.interaction.largest) / whole if whole else 0.0


@dataclass(frozen=True)
class Contributions(Tabulated):
    """What each named cause changes of every datum.

    against: what the idle model is, in a phrase. accounts: one for each quantity of each
    measurement. comparisons: the data beside the models with all causes, without any, and without
    each, in this order.
    """

    causes: tuple[str, ...]
    against: str
    accounts: tuple[Account, ...]
    comparisons: tuple[Comparison, ...] = ()

    def __repr__(self) -> str:
        """Causes and quantities."""
        quantities = ", ".join(account.title for account in self.accounts)
        return f"<Contributions of {' + '.join(self.causes)} to {quantities}>"

    def plot(self, comparison: int = 0) -> "Figure":
        """Draw what each cause contributes along the data, and what remains.

        Args: comparison: which of `comparisons`, from 0.
        Raises: ParameterError where there is none of that number.
        """
        count = len(self.comparisons)
        if not 0 <= comparison < count:
            raise ParameterError(f"comparison = {comparison}: there are {count}, from 0")
        draw = function("femnl.plot.contributions:contributions_figure")
        figure: Figure = draw(self.comparisons[comparison])
        return figure

    def to_dataframe(self) -> "pd.DataFrame":
        """Return a row a datum.

        Returns: measurement, where there are several; quantity and its unit; coordinates in SI,
            whose units are in `attrs["units"]`; sd; deviation from the idle model, which is the sum
            of what follows: a column a cause, interaction, remainder; and excluded, whether it is a
            glitch.
        """
        import pandas as pd

        frame = pd.concat([_frame(account) for account in self.accounts], ignore_index=True)
        if len({account.measurement for account in self.accounts}) < 2:
            del frame["measurement"]
        units = {
            name: unit
            for account in self.accounts
            for name, (_, unit) in account.coordinates.items()
        }
        frame.attrs = {"units": units}
        return frame

    def _tables(self) -> list[Table]:
        return [self._table(account) for account in self.accounts]

    def _table(self, account: Account) -> Table:
        terms = account.terms
        columns = {
            "term": [term.name for term in terms],
            "rms": [engineering(term.rms, account.unit) for term in terms],
            "largest": [engineering(term.largest, account.unit) for term in terms],
            "in σ": [plain(term.largest_sigma, 3) for term in terms],
            "at": [term.where for term in terms],
        }
        notes = [f"deviation = sum of the others; counted from {self.against}"]
        if len(self.causes) > 1:
            notes.append(f"interaction: {_percent(account.interaction_part)} of the whole change")
        return Table(f"What each cause changes: {account.title}", columns, notes)


def contributed(predictions: NDArray[Number]) -> tuple[NDArray[Number], NDArray[Number]]:
    """Return what each cause contributes (n_causes, …), and the interaction (…).

    A contribution is what is lost where a cause is idle beside the others, F(all) − F(all but k).
    The interaction is what all change together beyond their sum, [F(all) − F(none)] − Σ; that of
    one cause is 0.

    Args: predictions (2 + n_causes, …): with all causes, with none, and without each.
    """
    whole = predictions[0]
    causes = whole - predictions[2:]
    return causes, (whole - predictions[1]) - causes.sum(axis=0)


def _frame(account: Account) -> "pd.DataFrame":
    import pandas as pd

    columns = {
        "measurement": account.measurement,
        "quantity": account.quantity,
        "unit": account.unit,
        **{name: values for name, (values, _) in account.coordinates.items()},
        "sd": account.sd,
        **{term.name: term.values for term in account.terms},
        "excluded": account.excluded,
    }
    return pd.DataFrame(columns)


def _percent(part: float) -> str:
    return f"{plain(100 * part, 3)} %"
