"""The mode that sweeps show at first sight: where a diagnosis of them starts."""

import hashlib

import numpy as np
import xarray as xr

from femnl.core.checkpoint import Checkpoint
from femnl.core.fit import Fit
from femnl.core.readout import Array
from femnl.fits.response.choice import first_look
from femnl.fits.response.fit import first_layout
from femnl.fits.response.single_sweeps import (
    BENT,
    OTHER_SIGN,
    SingleSweeps,
    beside_background,
    is_astray,
    without_background,
)
from femnl.fits.response.tried import ADEQUATE
from femnl.observe.response.sweeps import collect, first_harmonics

FAR_BETTER = 4.0
"""Factor by which a background must lower χ² before it is taken to hide the resonance."""
LED_ASTRAY = 100.0
"""Factor by which a weaker background must lower χ² before it is taken to hide the resonance, from
which a fit without it must be astray.
"""
HIDES = 0.03
"""Background over the height of the resonance from which on it may hide that."""
MISSES = 10.0
"""Reduced χ² of a first fit from which on the other sign of the phase may be right."""
CERTAIN = 5.0
SHOWN = 0.1
"""Standard deviations of a stiffening or softening that is believed, and its part of the critical
one where a misfit withholds them.
"""


def first_fit(
    dataset: xr.Dataset, place: tuple[str, ...], checkpoint: Checkpoint | None
) -> tuple[int, dict[str, float]]:
    """Return the sign of the phase, and the values of a fit of one mode by their names.

    Among them are `background` [V/V]: how strong the background is that hides the mode, 0 where
    none does; `hidden`: 1 where a background or strong drives hide the mode, 0 elsewhere; and
    `softens`: 1 where the fit is sure that the mode softens, 0 elsewhere. Where it is sure of
    neither sign, as with a linear mode, α is no smaller than its standard deviation, so that what
    the data allow is within reach of a fit that starts there.

    Each process of a diagnosis poses the sweeps: the checkpoint keeps for the others what the first
    one found in seconds.

    Args: place: how names end, by position.
    """
    clear = collect(dataset)
    names = ["frequency", "linewidth", f"alpha_y{place[0]}"]
    names += [f"{name}{end}" for name in ("y_max", "phase") for end in place]

    def find() -> tuple[Array, Array]:
        look = first_look(clear, first_layout(clear, "complex"))
        sign = look.phase_sign
        singles = SingleSweeps(dataset, place)
        # On a circle beside a background, a fit without that would search in vain
        plain = None if look.on_circle else without_background(dataset, sign)
        one = None if plain is None else singles.of_drift(plain, sign)
        weak = None
        if plain is not None and one is not None:
            fitted, background, clearest = plain, 0.0, plain
        else:
            fitted, background, clearest = _fitted(dataset, sign, place, clear.reference, plain)
            if clearest.chi2_reduced > MISSES and not singles.show(sign):
                # A strong leak may hide the sign of the phase from the few fits that were to tell
                turned = without_background(dataset, -sign)
                other = _fitted(dataset, -sign, place, clear.reference, turned)
                if other[2].chi2_reduced < clearest.chi2_reduced / OTHER_SIGN:
                    sign = -sign
                    fitted, background, clearest = other
            weak = of_weak_sweeps(dataset, fitted, names[2], sign) if background == 0 else None
            if background == 0 and weak is None:
                one = singles.earliest_clear(fitted, sign)
        hidden = background > 0 or weak is not None or one is not None
        shown = weak or fitted
        values = {name: shown[name] for name in names}
        sd = shown.parameters[names[2]].sd
        turns = _shown_sign(weak or clearest, names[2])
        if one is not None:
            found, sd = one.of_all(fitted, place)
            values |= found
            turns = _shown_sign(one.fitted, "alpha_y")
        if turns == 0 and np.isfinite(sd):
            values[names[2]] = max(abs(values[names[2]]), sd)
        told = [background, float(hidden), float(turns < 0)]
        return np.array([*values.values(), *told]), np.array([sign])

    if checkpoint is None:
        values, sign = find()
    else:
        digest = hashlib.sha256(clear.frequency.tobytes() + clear.voltage.tobytes())
        what = f"first fit of sweeps, sure that they soften or not, {digest.hexdigest()}"
        values, sign = checkpoint.recall(what, find)
    told = ["background", "hidden", "softens"]
    return int(sign[0]), dict(zip([*names, *told], values.tolist(), strict=True))


def _fitted(
    dataset: xr.Dataset, sign: int, place: tuple[str, ...], reference: float, best: Fit | None
) -> tuple[Fit, float, Fit]:
    """Return a fit to start from, the background that hides the mode [V/V], and a fit for a sign.

    The background is 0 where none hides it. The last fit tells whether the mode stiffens or
    softens: it is that beside a background where this is far better, since a leak bends a linear
    resonance either way.

    Damping that grows with the amplitude, or a background, is in it where that describes the data.
    Whether they are there is for the diagnosis to say; here they only make the start safe. A
    background that is weaker than the resonance mostly hides nothing: the mode is found without it.

    Args: best: a fit without a background; None where a mode beside one is known to meet the data.
    """
    if best is None:
        beside, background, resonance = beside_leak(dataset, sign, place, reference)
        return beside, background if background > HIDES * resonance else 0.0, beside
    if best.chi2_reduced < ADEQUATE:
        return best, 0.0, best
    beside, background, resonance = beside_leak(dataset, sign, place, reference)
    gain = best.chi2_reduced / beside.chi2_reduced
    clearest = beside if gain > FAR_BETTER else best
    stronger = background > resonance and gain > FAR_BETTER
    if stronger or (is_astray(best, beside) and gain > LED_ASTRAY):
        return beside, background, clearest
    return best, 0.0, clearest


def beside_leak(
    dataset: xr.Dataset, sign: int, place: tuple[str, ...], reference: float
) -> tuple[Fit, float, float]:
    """Return a fit of one mode beside a background, and how strong this and the mode are [V/V]."""
    beside = beside_background(dataset, sign)
    background = max(_leak(beside, name, reference) for name in place)
    resonance = max(beside[f"y_max{name}"] for name in place)
    return beside, background, resonance


def of_weak_sweeps(dataset: xr.Dataset, fitted: Fit, stiffness: str, sign: int) -> Fit | None:
    """Return a fit to weak sweeps where only they show that the mode stiffens.

    A readout that bends over several fringes makes sweeps at strong drives look as if they
    softened, and so does a mode that drifts downwards while the drive is raised. No fit leads from
    there to the other sign. Those at the weakest drive are asked first, then each sweep alone, the
    weaker ones first, until one whose fit is not bent, either, is sure of a sign. Where the readout
    has several positions, all sweeps at one drive stand for a single one.

    None where the fit to all drives may be right, where no sweep is sure that the mode stiffens, or
    where no drive is known that was measured at all positions.

    Args: fitted: to all drives. stiffness: the name of α in fits.
    """
    if fitted.chi2_reduced < BENT or fitted[stiffness] > 0 or "drive" not in dataset:
        return None
    dataset = dataset.isel(sweep=first_harmonics(dataset)[0])
    drive = np.abs(dataset["drive"].values)
    levels = [dataset.isel(sweep=np.flatnonzero(drive == level)) for level in np.unique(drive)]
    places = collect(dataset).n_positions
    levels = [level for level in levels if collect(level).n_positions == places]
    if levels and levels[0].sizes["sweep"] < len(drive):
        weak = without_background(levels[0], sign)
        if _shown_sign(weak, stiffness) > 0 and weak.chi2_reduced < fitted.chi2_reduced / BENT:
            return weak
    order = np.argsort(drive, kind="stable") if len(drive) > 1 else ()
    single = [dataset.isel(sweep=[row]) for row in order] if places == 1 else levels
    for part in single:
        alone = without_background(part, sign)
        sign_of_stiffness = _sure_sign(alone, stiffness)
        if alone.chi2_reduced < BENT and sign_of_stiffness:
            return alone if sign_of_stiffness > 0 else None
    return None


def _shown_sign(fitted: Fit, stiffness: str) -> int:
    """Return the sign of α that a fit shows, 0 where it may be of either sign.

    Where a misfit withholds the standard deviation, it must bend the resonance visibly.
    """
    if np.isfinite(fitted.parameters[stiffness].sd):
        return _sure_sign(fitted, stiffness)
    ratio = fitted["alpha_ratio"]
    return int(np.sign(ratio)) if abs(ratio) > SHOWN else 0


def _sure_sign(fitted: Fit, stiffness: str) -> int:
    """Return the sign of α, 0 where a fit is not sure of it or gives no standard deviation."""
    found = fitted.parameters[stiffness]
    sure = np.isfinite(found.sd) and abs(found.value) > CERTAIN * found.sd
    return int(np.sign(found.value)) if sure else 0


def _leak(fitted: Fit, place: str, reference: float) -> float:
    """Return how strong the background at a place is by the drive [V/V].

    Args: reference: the strongest drive [V], to which a background that does not grow counts.
    """
    real, imag = (fitted.parameters[f"background_{part}{place}"] for part in ("real", "imag"))
    return float(np.hypot(real.value, imag.value)) / (1.0 if real.unit == "V/V" else reference)
