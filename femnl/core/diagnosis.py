"""What a diagnosis says: `diagnosis.json`, version 1.0, and what its report shows beside it."""

from dataclasses import dataclass
from typing import Literal

from femnl.core.comparison import Comparison
from femnl.core.fit import Parameter

Verdict = Literal["adequate", "explained", "ambiguous", "unexplained"]


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
class Diagnosis:
    """The verdict on one measurement file.

    parameters: by owner ("base" or the cause), then by name. For the report: base_parameters, those
    of the base model alone; trials; notes; sentences on the causes; comparisons: the data beside
    the base model and the one that the verdict rests on; free_forms, where nothing explains the
    data; geometry: that was asked for instead of the file's own.
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

    @property
    def gain(self) -> float:
        """Held-out χ² before over after."""
        return self.before.heldout_chi2_reduced / self.after.heldout_chi2_reduced
