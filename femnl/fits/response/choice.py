"""The choice between models of a response by evidence: background, delay, stiffening, phase sign.

Models are compared by the Bayesian information criterion χ²/s² + k ln n, the Laplace approximation
of the evidence with unit-information priors. s² is 1 where the noise is stated and met, and else
the least χ²/ν of all models, times what a pattern in its residuals makes each count less, so that
noise that is estimated, or a deviation that no model here explains, does not count as evidence.
Source: G. Schwarz, Annals of Statistics 6, 461 (1978).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from femnl.core.choices import Use
from femnl.fits.response.candidate import Candidate
from femnl.fits.response.start import likely_sign
from femnl.fits.response.tried import Asked, TriedModels, scale_of
from femnl.observe.response.sweeps import Sweeps
from femnl.observe.response.theta import Layout

MARGIN = 5.0
"""What a Duffing term must gain beyond its parameter: with it, noise alone makes one in 1 000."""
SIGN_MARGIN = 10.0
"""Fall of χ²/s² from which on the phase is taken to rise with frequency."""
MOSTLY = 0.3
"""Of the χ² of the richest linear model: what leaves less has a jump, and the right sign."""
CLEARLY = 0.25
"""Of the χ² of the other sign: what leaves less is likelier, though no model is met. A strong line
beside the resonance may leave half of it under the wrong sign.
"""
CONJUGATED = (
    "the phase rises through the resonance, so the data follow exp(−iωt); they are conjugated, and "
    "phase and background are those of exp(+iωt)"
)


@dataclass(frozen=True)
class Choice:
    """The model chosen, all that were fitted, s², and the sign of the phase found."""

    best: Candidate
    candidates: tuple[Candidate, ...]
    scale: float
    phase_sign: int

    def gain(self, other: Candidate) -> float:
        """Return by how much the chosen model's criterion is lower."""
        return other.criterion(self.scale) - self.best.criterion(self.scale)

    def rival(self, *, duffing: bool) -> Candidate | None:
        """Return the best of the models with, or without, a Duffing term."""
        found = [one for one in self.candidates if one.variant.duffing == duffing]
        return min(found, key=lambda one: one.criterion(self.scale)) if found else None


@dataclass(frozen=True)
class FirstLook:
    """What few fits tell of complex data.

    phase_sign: +1 for exp(+iωt), −1 for exp(−iωt). on_circle: whether a Duffing mode beside a
    background that grows with the drive leaves little more than the noise, and no linear one does.
    """

    phase_sign: int
    on_circle: bool


def choose(sweeps: Sweeps, layout: Layout, use: Use, asked: Asked) -> Choice:
    """Fit the models that are allowed and return the one that the evidence prefers.

    A resonance runs through its circle clockwise, with or without background, delay or stiffening:
    the sign of the phase is that of the file unless the other one leaves much less. Where no model
    describes the data, it is the one that leaves clearly less, or else that of the linear form.

    Args: layout: of θ, its background yet to be chosen.
    """
    tried = _begun(sweeps, layout, use, asked)
    sign = _sign(sweeps, tried)
    chosen = tried[sign]
    if use == "complex":
        chosen.fit_complex()
    else:
        chosen.fit_partial()
    return _best(sweeps, list(chosen.found.values()), asked, sign)


def first_look(sweeps: Sweeps, layout: Layout) -> FirstLook:
    """Return what few fits tell of complex data; see `choose` for the sign of their phase."""
    tried = _begun(sweeps, layout, "complex", Asked())
    sign = _sign(sweeps, tried)
    return FirstLook(sign, tried[sign].quiet_on_circle)


def _begun(sweeps: Sweeps, layout: Layout, use: Use, asked: Asked) -> dict[int, TriedModels]:
    """Return the fits that decide on the sign of the phase, by the signs that are open.

    Duffing models are among them, from circles and then across folds, where no linear one is `met`.
    """
    signs = [asked.phase_sign] if asked.phase_sign else [1, -1]
    if use == "magnitude" or not sweeps.phases:
        signs = [1]
    tried: dict[int, TriedModels] = {}
    for sign in signs:
        tried[sign] = TriedModels(turned(sweeps, sign), layout, use, asked)
        if tried[sign].begin() and use != "complex":
            break
    if len(tried) > 1 and not any(fits.met for fits in tried.values()):
        linear = {sign: dict(fits.found) for sign, fits in tried.items()}
        for fits in tried.values():
            fits.fit_on_circle()
        if not any(fits.met for fits in tried.values()):
            # On a circle the wrong sign may leave less than the right one until one is met
            for sign, fits in tried.items():
                fits.found.clear()
                fits.found.update(linear[sign])
            _search_folds(tried, likely_sign(sweeps))
    return tried


def _search_folds(tried: Mapping[int, TriedModels], likely: int) -> None:
    """Add Duffing models across folds to `tried`, the likely sign first, until one decides."""
    if _clear(tried, likely):
        # Where linear models decide, folds need no search
        return
    linear = min(fits.least for fits in tried.values())
    for fits in (tried[likely], tried[-likely]):
        fits.fit_across_folds()
        if fits.met or fits.least < MOSTLY * linear:
            return


def _sign(sweeps: Sweeps, tried: Mapping[int, TriedModels]) -> int:
    """Return the sign of the phase; see `choose`."""
    first, *others = tried
    if not others:
        return first
    if any(fits.met for fits in tried.values()) or _clear(tried, -1):
        return -1 if _turns(sweeps, tried) else first
    return first if _clear(tried, first) else likely_sign(sweeps)


def _clear(tried: Mapping[int, TriedModels], sign: int) -> bool:
    """Whether one sign of the phase leaves clearly less than the other."""
    return tried[sign].least < CLEARLY * tried[-sign].least


def _turns(sweeps: Sweeps, tried: Mapping[int, TriedModels]) -> bool:
    """Whether the phase rises: the data conjugated leave so much less."""
    least = {sign: fits.least for sign, fits in tried.items()}
    other = min(tried[-1].found.values(), key=lambda one: one.chi2)
    floor = other.chi2_reduced if sweeps.estimated else max(other.chi2_reduced, 1.0)
    return least[1] - least[-1] > SIGN_MARGIN * floor


def turned(sweeps: Sweeps, sign: int) -> Sweeps:
    """Return sweeps with the phase convention exp(+iωt), where they have `sign` of it."""
    return sweeps if sign > 0 else replace(sweeps, voltage=sweeps.voltage.conj())


def _best(sweeps: Sweeps, found: Sequence[Candidate], asked: Asked, sign: int) -> Choice:
    """Return the model of the least criterion; a Duffing term must gain MARGIN beside it."""
    scale = scale_of(sweeps, found)

    def price(one: Candidate) -> float:
        return one.criterion(scale) + (MARGIN if one.variant.duffing else 0.0)

    return Choice(min(found, key=price), tuple(found), scale, sign)
