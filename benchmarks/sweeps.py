"""Fits of linear resonators on a background: femnl beside two scripts as users write them.

Run `python -m benchmarks.sweeps [COUNT]`; it prints a table. Resonators are those of the test of
random oscillators: Q of 3…1e8, background, delay, either sign of phase. The first script fits the
exact oscillator with a complex constant and slope by least squares from the extremes of the data,
as programs for vibrating wires do; the second is the same model in lmfit with start values from the
peak. Neither knows of a delay or of a rising phase. Times are processor times.
"""

import sys
import time
from collections.abc import Callable

import numpy as np
import xarray as xr
from lmfit.minimizer import minimize
from lmfit.parameter import Parameters
from numpy.typing import NDArray
from scipy.optimize import least_squares

from femnl.fits.response.fit import fit_response
from tests.unit.test_fits_sweeps import SEED, draw, line

Array = NDArray[np.float64]
SUCCESS = 5.0
"""Standard deviations of femnl's fit, or 1 % of a linewidth, within which a frequency is right."""


def _data(data: xr.Dataset) -> tuple[Array, NDArray[np.complex128]]:
    f = np.asarray(data["frequency"].values[0], float)
    volts = data["real"].values[0] + 1j * data["imag"].values[0]
    return f, volts / np.abs(volts).max()


def _columns(f: Array, f0: float, w: float) -> NDArray[np.complex128]:
    away = (f - f.mean()) / np.ptp(f)
    return np.column_stack([line(f, f0, w), np.ones(f.size), away])


def _start(f: Array, volts: NDArray[np.complex128]) -> tuple[float, float]:
    """Return place and width of the largest signal off its mean."""
    size = np.abs(volts - np.mean(volts))
    above = f[size > size.max() / np.sqrt(2)]
    return float(f[np.argmax(size)]), max(float(np.ptp(above)), float(f[1] - f[0]))


def by_least_squares(data: xr.Dataset) -> tuple[float, float]:
    """Return f₀ and w [Hz] of the exact oscillator with constant and slope."""
    f, volts = _data(data)
    f0, w = _start(f, volts)

    def residual(p: Array) -> Array:
        columns = _columns(f, f0 + p[0] * w, w * float(np.exp(np.clip(p[1], -20, 20))))
        left = volts - columns @ np.linalg.lstsq(columns, volts, rcond=None)[0]
        return np.concatenate([left.real, left.imag])

    found = least_squares(residual, [0.0, 0.0]).x
    return f0 + found[0] * w, w * float(np.exp(found[1]))


def by_lmfit(data: xr.Dataset) -> tuple[float, float]:
    """Return f₀ and w [Hz] of the same model, all parameters explicit, by lmfit."""
    f, volts = _data(data)
    f0, w = _start(f, volts)
    parameters = Parameters()
    parameters.add("shift", 0.0)
    parameters.add("growth", 0.0, min=-20, max=20)
    for name in ("ar", "ai", "br", "bi", "cr", "ci"):
        parameters.add(name, 1.0 if name == "ar" else 0.0)

    def residual(p: Parameters) -> Array:
        v = p.valuesdict()
        columns = _columns(f, f0 + v["shift"] * w, w * float(np.exp(v["growth"])))
        parts = [v[f"{name}r"] + 1j * v[f"{name}i"] for name in "abc"]
        left = volts - columns @ np.array(parts)
        return np.concatenate([left.real, left.imag])

    found = minimize(residual, parameters).params.valuesdict()
    return f0 + found["shift"] * w, w * float(np.exp(found["growth"]))


def by_femnl(data: xr.Dataset) -> tuple[float, float]:
    """Return f₀ and w [Hz] of femnl."""
    fit = fit_response(data)
    return fit["frequency"], fit["linewidth"]


def main(count: int) -> None:
    """Fit `count` resonators by each, and print how many are right and how long one takes."""
    methods: dict[str, Callable[[xr.Dataset], tuple[float, float]]] = {
        "femnl": by_femnl,
        "least squares, constant and slope": by_least_squares,
        "lmfit, constant and slope": by_lmfit,
    }
    right = dict.fromkeys(methods, 0)
    spent = dict.fromkeys(methods, 0.0)
    for k in range(count):
        data, truth = draw(np.random.default_rng([SEED, k]))
        width = truth["frequency"] / truth["quality_factor"]
        sd = fit_response(data).parameters["frequency"].sd
        for name, method in methods.items():
            start = time.process_time()
            with np.errstate(all="ignore"):
                f0, _ = method(data)
            spent[name] += time.process_time() - start
            right[name] += abs(f0 - truth["frequency"]) < max(SUCCESS * sd, 0.01 * width)
    for name in methods:
        share = f"{right[name]} of {count} right"
        sys.stdout.write(f"{name}: {share}, {1e3 * spent[name] / count:.0f} ms each\n")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 200)
