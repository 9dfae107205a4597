"""What single sweeps show of a mode that all of them together hide."""

from collections.abc import Iterator
from itertools import tee
from typing import NamedTuple

import numpy as np
import xarray as xr

from femnl.core.errors import ConvergenceError
from femnl.core.fit import Fit
from femnl.fits.response.fit import fit_response
from femnl.fits.response.start import CLEAR
from femnl.fits.response.tried import ADEQUATE
from femnl.observe.response.sweeps import collect, first_harmonics

ELSEWHERE = 1.0
OF_ANOTHER_WIDTH = 3.0
"""Linewidths by which a fit must have the mode elsewhere, or factor by which it must have it wider
or narrower, to be led astray.
"""
FIRST_SWEEPS = 8
"""Earliest sweeps that are asked, one by one, whether they show the mode alone."""
OTHER_SIGN = 10.0
"""Factor by which χ² must be lower under one sign of the phase than under the other."""
BENT = 10.0
"""Reduced χ² of a fit to all sweeps from which on they may show something else than the mode."""


def without_background(dataset: xr.Dataset, sign: int) -> Fit:
    """Return the better fit of one mode with or without damping that grows with the amplitude."""
    found: list[Fit] = []
    for damped in (True, False):
        fitted = fit_response(
            dataset,
            "complex",
            background="none",
            duffing=True,
            delay=True,
            phase_sign=sign,
            nonlinear_damping=damped,
        )
        if fitted.chi2_reduced < ADEQUATE:
            return fitted
        found.append(fitted)
    return min(found, key=lambda one: one.chi2_reduced)


def beside_background(dataset: xr.Dataset, sign: int) -> Fit:
    """Return a fit of one mode beside a background and its slope."""
    return fit_response(
        dataset, "complex", background="slope", duffing=True, delay=True, phase_sign=sign
    )


class OneSweep(NamedTuple):
    """A sweep alone, a fit to it, and the end of names of its position."""

    sweep: xr.Dataset
    fitted: Fit
    end: str

    def of_all(self, fitted: Fit, place: tuple[str, ...]) -> tuple[dict[str, float], float]:
        """Return values by their names at all positions, and the standard deviation of α.

        What is read at other positions is no smaller than a fit to all of them says.
        """
        mine = self.fitted
        values = {name: mine[name] for name in ("frequency", "linewidth")}
        for end in place:
            own = end == self.end
            size = mine["y_max"]
            values[f"y_max{end}"] = size if own else max(size, fitted[f"y_max{end}"])
            values[f"phase{end}"] = mine["phase"] if own else fitted[f"phase{end}"]
        units = (mine["y_max"] / values[f"y_max{place[0]}"]) ** 2
        values[f"alpha_y{place[0]}"] = mine["alpha_y"] * units
        return values, mine.parameters["alpha_y"].sd * units


class SingleSweeps:
    """Fits to the first few sweeps, by rising time; each is made when it is first asked for.

    Args: place: how names end, by position.
    """

    def __init__(self, dataset: xr.Dataset, place: tuple[str, ...]) -> None:
        self._dataset = dataset
        self._place = place
        self._begun: dict[int, Iterator[OneSweep | None]] = {}

    def earliest_clear(self, together: Fit, sign: int) -> OneSweep | None:
        """Return the earliest sweep that is clear alone, where all together hide its mode.

        A mode that drifts by more than its width from sweep to sweep looks wide, or is sought where
        it was late. None where the fit to all sweeps may be right, where the sweep agrees with it,
        or where none of the first few is clear.
        """
        if together.chi2_reduced < BENT:
            return None
        first = next((one for one in self._fits(sign) if one is not None), None)
        return first if first is not None and is_astray(together, first.fitted) else None

    def of_drift(self, together: Fit, sign: int) -> OneSweep | None:
        """Return the first sweep, where a later clear one has the mode elsewhere: it drifts.

        Neither a background nor the other sign of the phase does that. None where the first sweep
        is not clear, or where a fit to all sweeps may be right or agrees with it.
        """
        if together.chi2_reduced < BENT:
            return None
        fits = self._fits(sign)
        first = next(fits, None)
        if first is None or not is_astray(together, first.fitted):
            return None
        later = (one.fitted for one in fits if one is not None)
        return first if any(_away(one, first.fitted) > ELSEWHERE for one in later) else None

    def show(self, sign: int) -> bool:
        """Whether a clear sweep shows this sign of the phase.

        A mode alone meets it, and under the other sign none does, not even beside a background.
        """
        clear = (one for one in self._fits(sign) if one is not None)
        return any(
            beside_background(one.sweep, -sign).chi2_reduced > OTHER_SIGN * one.fitted.chi2_reduced
            for one in clear
        )

    def _fits(self, sign: int) -> Iterator[OneSweep | None]:
        """Yield the fit to each sweep, None for one that is not clear alone."""
        begun = self._begun.get(sign) or self._fitted(sign)
        again, self._begun[sign] = tee(begun)
        return again

    def _fitted(self, sign: int) -> Iterator[OneSweep | None]:
        kept, _ = first_harmonics(self._dataset)
        if len(kept) == 1:
            return  # a fit to it is one to all
        together = collect(self._dataset)
        time = self._dataset["time"].values[kept] if "time" in self._dataset else kept
        for row in kept[np.argsort(time, kind="stable")][:FIRST_SWEEPS]:
            mine = together.row == row
            if not mine.any():
                continue
            # One sweep alone tells its noise less well than all of them
            part = self._dataset.isel(sweep=[row]).assign_attrs(noise_sd=together.noise)
            try:
                alone = without_background(part, sign)
            except ConvergenceError:  # it is not clear
                yield None
                continue
            low, high = (side(together.frequency[mine]) for side in (np.min, np.max))
            drive = float(np.max(together.drive[mine])) * together.reference
            loud = alone["y_max"] * drive > CLEAR * together.noise
            clear = alone.chi2_reduced < ADEQUATE and low < alone["frequency"] < high and loud
            end = self._place[int(together.position[mine][0])]
            yield OneSweep(part, alone, end) if clear else None


def is_astray(one: Fit, right: Fit) -> bool:
    """Whether a fit finds another mode than the right one: elsewhere, or of another width."""
    broader = abs(np.log(one["linewidth"] / right["linewidth"]))
    return bool(_away(one, right) > ELSEWHERE or broader > np.log(OF_ANOTHER_WIDTH))


def _away(one: Fit, right: Fit) -> float:
    """Return by how many linewidths of the right fit another one has the mode elsewhere."""
    return float(abs(one["frequency"] - right["frequency"]) / right["linewidth"])
