"""What a diagnosis says: `diagnosis.json`, and what its report shows beside it."""

from dataclasses import dataclass
from math import inf
from typing import TYPE_CHECKING, Literal

import numpy as np

from femnl.core.arrays import freeze
from femnl.core.comparison import Comparison
from femnl.core.contributions import Contributions
from femnl.core.device import Model
from femnl.core.errors import ParameterError
from femnl.core.fit import Parameter, parameter_columns
from femnl.core.kinds import function
from femnl.core.numbers import plain
from femnl.core.readout import Array
from femnl.core.tables import Table, Tabulated

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

Verdict = Literal["adequate", "explained", "explained in part", "ambiguous", "unexplained"]
SHOWN = 10
"""Trials that a table lists, the best ones."""


@dataclass(frozen=True)
class Quality:
    """χ² per degree of freedom of a fit, and per datum on blocks that the fit did not see."""

    chi2_reduced: float
    heldout_chi2_reduced: float


@dataclass(frozen=True)
class Alternative:
    """A set of causes and its posterior probability among all that were tried."""

    causes: tuple[str, ...]
    probability: float


@dataclass(frozen=True)
class Trial:
    """One extended model that was fitted.

    Causes, χ², logarithm of the evidence over that of the base, p-value, what speaks against it.
    """

    causes: tuple[str, ...]
    chi2: float
    log_evidence: float
    p_value: float
    against: tuple[str, ...]


@dataclass(frozen=True)
class FreeForm:
    """An extension that describes and does not explain.

    What it is, its equation, number of parameters, and quality.
    """

    sentence: str
    equation: str
    n_parameters: int
    quality: Quality


@dataclass(frozen=True)
class Bound:
    """The range [low, high] in `unit` that a parameter of a named cause has, and why."""

    cause: str
    name: str
    low: float
    high: float
    unit: str
    reason: str


@dataclass(frozen=True)
class Cause:
    """What the library says of a named cause.

    The sentence that names it, its equation, the source of that, and how far it holds.
    """

    name: str
    sentence: str
    equation: str
    source: str
    limits: str


@dataclass(frozen=True)
class Covariance:
    """Covariance (p, p) of fitted parameters in SI, by owner ("base" or the cause) and name.

    It holds what the data say. Errors that no amount of data lowers are in the standard deviations
    of `Diagnosis.parameters` only. Whole numbers have no covariance.
    """

    owners: tuple[str, ...]
    names: tuple[str, ...]
    matrix: Array

    def __post_init__(self) -> None:
        freeze(self)

    @property
    def correlation(self) -> Array:
        """Covariance over both standard deviations (p, p)."""
        sd = np.sqrt(np.diag(self.matrix))
        return np.asarray(self.matrix / np.outer(sd, sd))


@dataclass(frozen=True)
class Share:
    """How much of what the simulation gets wrong one cause takes up.

    share: the part of the base model's held-out excess χ² that goes when the cause is added to the
    others of the set, with its standard deviation over the blocks held out. alone: when it is added
    to the base model.
    """

    cause: str
    share: float
    sd: float
    alone: float


@dataclass(frozen=True)
class Remainder:
    """What the named causes leave.

    χ² per degree of freedom, and per datum held out; largest_sigma: of any datum; in_units: the
    largest deviation that is left beside the largest of the base model, such as "480 Hz of 73 kHz";
    where: it is, and the free form that describes it best; significant: whether it is more than
    noise.
    """

    chi2_reduced: float
    heldout_chi2_reduced: float
    largest_sigma: float
    in_units: str
    where: str
    significant: bool


@dataclass(frozen=True)
class Excluded:
    """A datum that was left out as a glitch: where it is, and by how many σ it deviates."""

    where: str
    sigma: float


@dataclass(frozen=True)
class NoiseTold:
    """Noise of one measurement: its standard deviation as stated and as found, in `unit`.

    correlation_length: how many neighbouring data count as one, 1 where they are independent.
    """

    measurement: str
    stated: float
    found: float
    correlation_length: float
    unit: str


@dataclass(frozen=True)
class Rival:
    """A set of causes that the data do not tell from the one of the verdict.

    probability: among all that were tried; more: what the library says of those of its causes that
    neither the verdict nor an earlier rival names.
    """

    causes: tuple[str, ...]
    probability: float
    more: tuple[Cause, ...]


@dataclass(frozen=True)
class Diagnosis(Tabulated):
    """The verdict on one measurement file.

    parameters: by owner ("base" or the cause), then by name. For the report: base_parameters, those
    of the base model alone; trials; notes; sentences on the causes; comparisons: the data beside
    the base model and the one that the verdict rests on; free_forms, where nothing explains the
    data; geometry: that was asked for instead of the file's own. rule: the
    one of `femnl.diagnose.verdict.RULES` that decided. bounds: of the parameters of the causes.
    shares: of each named cause; remainder: what they leave, None where nothing is named; excluded:
    glitches, which no fit has seen; noise: of each measurement whose data tell it. contributions:
    what each named cause changes of every datum, None where nothing is named. explained: what the
    library says of each cause; rivals: the other sets where the verdict is `ambiguous`. covariance:
    of `parameters`. residuals (n,): what the verdict's model leaves of the data, in σ as found,
    neighbours made independent. best_trial: the causes that come closest, where nothing explains
    the data. model: the device, None of a record without one.
    """

    file: str
    sha256: str
    verdict: Verdict
    causes: tuple[str, ...]
    probability: float
    parameters: dict[str, dict[str, Parameter]]
    alternatives: tuple[Alternative, ...]
    p_value: float
    where: str
    before: Quality
    after: Quality
    measure_next: str
    base_parameters: dict[str, Parameter]
    trials: tuple[Trial, ...] = ()
    notes: tuple[str, ...] = ()
    sentences: tuple[str, ...] = ()
    comparisons: tuple[Comparison, ...] = ()
    free_forms: tuple[FreeForm, ...] = ()
    geometry: str | None = None
    rule: str = ""
    bounds: tuple[Bound, ...] = ()
    shares: tuple[Share, ...] = ()
    remainder: Remainder | None = None
    excluded: tuple[Excluded, ...] = ()
    noise: tuple[NoiseTold, ...] = ()
    contributions: Contributions | None = None
    explained: tuple[Cause, ...] = ()
    rivals: tuple[Rival, ...] = ()
    covariance: Covariance | None = None
    residuals: Array | None = None
    best_trial: tuple[str, ...] = ()
    model: Model | None = None

    @property
    def gain(self) -> float:
        """Held-out χ² before over after; 1 where data without any deviation leave both at 0."""
        before = self.before.heldout_chi2_reduced
        after = self.after.heldout_chi2_reduced
        if after == 0:
            return 1.0 if before == 0 else inf
        return before / after

    @property
    def nearest(self) -> str:
        """Which causes come closest where nothing explains the data, and what stands against them.

        An empty sentence where there is an answer, or nothing was tried.
        """
        if not self.best_trial:
            return ""
        tried = {trial.causes: trial for trial in self.trials}
        before, best = tried[()], tried[self.best_trial]
        return (
            f"nearest comes {_joined(best.causes)}, with χ² = {plain(best.chi2, 4)} instead of "
            f"{plain(before.chi2, 4)}; against it: {'; '.join(best.against)}"
        )

    def __repr__(self) -> str:
        """Verdict, causes with their probability, and file."""
        odds = f", probability {self.probability:.3g}" if self.causes else ""
        return f"<Diagnosis of {self.file}: {self._finding()}{odds}>"

    def plot(self, comparison: int = 0) -> "Figure":
        """Draw data, models and what each leaves, of one comparison.

        Args: comparison: which of `comparisons`, from 0; of several measurements there are several.
        Raises: ParameterError where there is none of that number.
        """
        count = len(self.comparisons)
        if not 0 <= comparison < count:
            raise ParameterError(f"comparison = {comparison}: this diagnosis holds {count}, from 0")
        draw = function("femnl.plot.comparison:comparison_figure")
        figure: Figure = draw(self.comparisons[comparison])
        return figure

    def to_dataframe(self) -> "pd.DataFrame":
        """Return a row a trial, the one of highest evidence first.

        Returns: causes joined by " + ", "base model" where there are none; chi2; log_evidence,
            natural and over that of the base model; p_value; against, sentences joined by "; ".
        """
        import pandas as pd

        ranked = self._ranked()
        columns = {
            "causes": [_joined(trial.causes) for trial in ranked],
            "chi2": [trial.chi2 for trial in ranked],
            "log_evidence": [trial.log_evidence for trial in ranked],
            "p_value": [trial.p_value for trial in ranked],
            "against": ["; ".join(trial.against) for trial in ranked],
        }
        return pd.DataFrame(columns)

    def _finding(self) -> str:
        return f"{self.verdict}: {_joined(self.causes)}" if self.causes else self.verdict

    def _ranked(self) -> list[Trial]:
        return sorted(self.trials, key=lambda trial: -trial.log_evidence)

    def _tables(self) -> list[Table]:
        owners = [owner for owner, own in self.parameters.items() for _ in own]
        listed = [parameter for own in self.parameters.values() for parameter in own.values()]
        found = {"of": owners} | parameter_columns(listed)
        title = f"{self.file}: {self._finding()}"
        quality = f"χ² per held-out datum: {self.before.heldout_chi2_reduced:.4g}"
        # Without causes, nothing has a probability among others, and after is before
        if self.causes:
            title += f" (probability {self.probability:.3g})"
            quality += f" before, {self.after.heldout_chi2_reduced:.4g} after"
        notes = [self.where, *([self.nearest] if self.nearest else []), quality, self.measure_next]
        tables = [Table(title, found, notes)]
        return [*tables, self._tried()] if self.trials else tables

    def _tried(self) -> Table:
        best = self._ranked()[:SHOWN]
        columns = {
            "causes": [_joined(trial.causes) for trial in best],
            "χ²": [plain(trial.chi2, 5) for trial in best],
            "log evidence": [plain(trial.log_evidence, 4) for trial in best],
            "p-value": [_p_value(trial.p_value) for trial in best],
        }
        note = f"{len(best)} of {len(self.trials)} trials; log evidence over that of the base model"
        return Table("What was tried, best first", columns, [note])


def _p_value(p: float) -> str:
    """Return a p-value, and a bound where it is too small for a number."""
    return plain(p, 2) if p > 0 else "< 10⁻³⁰⁰"


def _joined(causes: tuple[str, ...]) -> str:
    return " + ".join(causes) or "base model"
