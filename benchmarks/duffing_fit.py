"""Duffing fits of random resonators: femnl beside lmfit with a model as users write it, in one run.

Run `python -m benchmarks.duffing_fit [FOLDER] [COUNT]`; it prints a table and writes
duffing_fit.csv. Each resonator has f₀ of 0.1…30 MHz, Q of 300…10⁶, α_y/α_c of 0.01…50 (a quarter
softening), noise of 0.01…5 % of y_max, any phase, a delay, one sweep up or down over the whole
response. The lmfit model takes the closed cubic roots for all points at once, chooses the branch by
the direction, and starts (a) from peak position, height and half width, (b) as (a) and then from
random starts until the misfit is that of noise, 20 at most, (c) from values a factor of two off,
(d) from the truth, which no user has. Times are processor times.
"""

import csv
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from lmfit.minimizer import minimize
from lmfit.parameter import Parameters
from numpy.typing import NDArray

from femnl.fits.response.fit import fit_response
from femnl.fits.response.misfit import Misfit
from femnl.io.measurement import response
from femnl.observe.response.branches import STIFFEN
from femnl.observe.response.sweeps import collect
from femnl.observe.response.theta import Layout
from femnl.resonator import duffing_roots

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Values = dict[str, float]
NAMES = ("frequency", "linewidth", "alpha_ratio", "y_max")
POINTS = 201
RESTARTS = 20
# Restarts take a second each resonator: so many show what they do.
SLOW = 200
# A fit has succeeded when every parameter lies within this many standard deviations of the truth.
SUCCESS = 5.0


@dataclass(frozen=True)
class Case:
    """One simulated sweep with its truth.

    Data, truth by name, and standard deviations from the Fisher information at the truth.
    """

    frequency: Array
    voltage: Complex
    direction: int
    noise: float
    truth: Values
    sd: Values


def draw(rng: np.random.Generator) -> Case:
    """Draw a resonator and simulate its sweep."""
    f0 = 10 ** rng.uniform(5, 7.5)
    q = 10 ** rng.uniform(2.5, 6)
    peak = 10 ** rng.uniform(-5, 0)
    w = f0 / q
    ratio = 10 ** rng.uniform(-2, np.log10(50)) * rng.choice([1, 1, 1, -1])
    noise = 10 ** rng.uniform(-4, np.log10(0.05)) * peak
    phase = rng.uniform(-np.pi, np.pi)
    direction = int(rng.choice([1, -1]))
    shift = w / 2 * STIFFEN * ratio
    margin = w * rng.uniform(3, 10, 2) + 0.05 * w * abs(ratio)
    frequency = np.linspace(f0 + min(0, shift) - margin[0], f0 + max(0, shift) + margin[1], POINTS)
    delay = rng.uniform(-0.5, 0.5) / np.ptp(frequency)
    delta = 2 * (f0 - frequency) / w
    roots = duffing_roots(2 * (f0 - frequency) / w, STIFFEN * ratio)
    x = np.where(np.isfinite(roots[2]), roots[2], roots[0]) if direction * ratio > 0 else roots[0]
    clean = (
        peak
        * np.exp(1j * phase - 2j * np.pi * (frequency - f0) * delay)
        / (delta + STIFFEN * ratio * x + 1j)
    )
    voltage = clean + noise * (rng.normal(size=POINTS) + 1j * rng.normal(size=POINTS))
    truth = {
        "frequency": f0,
        "linewidth": w,
        "alpha_ratio": ratio,
        "y_max": peak,
        "phase": phase,
        "delay": delay,
    }
    return Case(
        frequency,
        voltage,
        direction,
        noise,
        truth,
        limits(frequency, clean, direction, noise, truth),
    )


def limits(frequency: Array, clean: Complex, direction: int, noise: float, truth: Values) -> Values:
    """Return the Cramér–Rao standard deviations of NAMES at the truth."""
    sweeps = collect(response(frequency, clean, direction=direction, noise_sd=noise))
    layout = Layout(
        truth["frequency"], truth["linewidth"], 1.0, 1.0, 1, damping=False, gain=True, phase=True
    )
    theta = np.array(
        [0.0, 0.0, truth["alpha_ratio"], np.log(truth["y_max"]), truth["phase"], truth["delay"]]
    )
    misfit = Misfit.of(sweeps, layout, "complex")
    misfit.assign(theta)
    slopes = misfit.jacobian(theta, cautious=True)
    scale = np.linalg.norm(slopes, axis=0)
    sd = np.sqrt(np.diag(np.linalg.pinv(slopes.T @ slopes / np.outer(scale, scale)))) / scale
    return dict(
        zip(
            NAMES,
            sd[:4] * [truth["linewidth"], truth["linewidth"], 1.0, truth["y_max"]],
            strict=True,
        )
    )


def with_femnl(case: Case) -> tuple[Values, Values]:
    """Fit with femnl, which takes no start values."""
    fit = fit_response(
        response(case.frequency, case.voltage, direction=case.direction, noise_sd=case.noise)
    )
    return {name: fit[name] for name in NAMES}, {name: fit.parameters[name].sd for name in NAMES}


def duffing(
    f: Array,
    *,
    f0: float,
    w: float,
    y_max: float,
    alpha: float,
    phi: float,
    tau: float,
    direction: int,
) -> Complex:
    """The response of arXiv:2502.19191, S2, by the closed roots of its cubic in |y|²."""
    k = 0.375 * alpha * f0
    m = f0 - f
    c = (y_max * w / 2) ** 2
    if k == 0:
        y = y_max * w / 2 / (m + 0.5j * w)
    else:
        a2 = 2 * m / k
        a1 = (m**2 + w**2 / 4) / k**2
        a0 = -c / k**2
        p = a1 - a2**2 / 3
        q = 2 * a2**3 / 27 - a2 * a1 / 3 + a0
        s = np.sqrt((q / 2) ** 2 + (p / 3) ** 3 + 0j)
        # Of the two signs, the one that does not cancel.
        u = np.where(np.abs(-q / 2 + s) > np.abs(-q / 2 - s), -q / 2 + s, -q / 2 - s) ** (1 / 3)
        turns = np.exp(2j * np.pi / 3 * np.arange(3))[:, None]
        x = u * turns - p / (3 * u * turns) - a2 / 3
        real = np.abs(x.imag) < 1e-6 * np.abs(x)
        high, low = (
            reduce(np.where(real, x.real, fill), axis=0)
            for reduce, fill in ((np.max, -np.inf), (np.min, np.inf))
        )
        x2 = high if direction * alpha > 0 else low
        y = y_max * w / 2 / (m + k * x2 + 0.5j * w)
    return np.asarray(y * np.exp(1j * phi - 2j * np.pi * (f - f0) * tau))


def with_lmfit(case: Case, start: Values) -> tuple[Values, Values, float]:
    """Fit with lmfit's leastsq from the given start; return also the reduced χ²."""
    parameters = Parameters()
    for name, value in start.items():
        parameters.add(name, value, min=0.0 if name in ("w", "y_max") else -np.inf)

    def residual(p: Parameters) -> Array:
        model = duffing(case.frequency, **p.valuesdict(), direction=case.direction)
        return np.asarray(np.nan_to_num((case.voltage - model).view(float) / case.noise))

    result = minimize(residual, parameters, scale_covar=False)
    p = result.params.valuesdict()
    e = {name: item.stderr or np.nan for name, item in result.params.items()}
    critical = 32 * np.sqrt(3) / 27 * p["w"] / (p["f0"] * p["y_max"] ** 2)
    values = {
        "frequency": p["f0"],
        "linewidth": p["w"],
        "alpha_ratio": p["alpha"] / critical,
        "y_max": p["y_max"],
    }
    return (
        values,
        {"frequency": e["f0"], "linewidth": e["w"], "alpha_ratio": np.nan, "y_max": e["y_max"]},
        float(result.redchi),
    )


def guess(case: Case) -> Values:
    """Start as users do, without nonlinearity.

    From the highest point, its height and the width at half power.
    """
    size = np.abs(case.voltage)
    top = int(np.argmax(size))
    wide = case.frequency[size > size[top] / np.sqrt(2)]
    width = max(float(np.ptp(wide)), float(case.frequency[1] - case.frequency[0]))
    phase = float(np.angle(case.voltage[top])) + np.pi / 2
    return {
        "f0": case.frequency[top],
        "w": width,
        "y_max": size[top],
        "alpha": 0.0,
        "phi": phase,
        "tau": 0.0,
    }


def poor(case: Case) -> Values:
    """Start far from the truth.

    A factor of two off in w, y_max and α, three linewidths in f₀, one radian in phase.
    """
    t = exact(case)
    moved = {
        "f0": t["f0"] + 3 * t["w"],
        "w": 2 * t["w"],
        "y_max": t["y_max"] / 2,
        "alpha": 2 * t["alpha"],
        "phi": t["phi"] + 1,
    }
    return {**t, **moved, "tau": 0.0}


def restarted(case: Case) -> tuple[Values, Values]:
    """Fit from the usual guess, then from starts scattered about it, and keep the best.

    Stop when it meets the noise.
    """
    rng = np.random.default_rng(0)
    first = guess(case)
    best = None
    span = float(np.ptp(case.frequency))
    for attempt in range(RESTARTS):
        start = dict(first)
        if attempt:
            # The peak of a driven Duffing lies ⅜ α f₀ y² from f₀: draw that shift, and a width from
            # the step to the span.
            shift = rng.uniform(-1, 1) * span
            start |= {
                "f0": first["f0"] - shift,
                "alpha": shift / (0.375 * first["f0"] * first["y_max"] ** 2),
            }
            start |= {"w": span * 10 ** rng.uniform(-2.3, -0.5), "phi": rng.uniform(-np.pi, np.pi)}
        values, sd, chi2 = with_lmfit(case, start)
        if best is None or chi2 < best[2]:
            best = values, sd, chi2
        if chi2 < 1 + 3 * np.sqrt(1 / POINTS):
            break
    assert best is not None
    return best[:2]


def exact(case: Case) -> Values:
    """Start at the truth."""
    t = case.truth
    alpha = (
        t["alpha_ratio"]
        * 32
        * np.sqrt(3)
        / 27
        * t["linewidth"]
        / (t["frequency"] * t["y_max"] ** 2)
    )
    return {
        "f0": t["frequency"],
        "w": t["linewidth"],
        "y_max": t["y_max"],
        "alpha": alpha,
        "phi": t["phase"],
        "tau": t["delay"],
    }


METHODS: dict[str, Callable[[Case], tuple[Values, Values]]] = {
    "femnl, no start": with_femnl,
    "lmfit, usual guess": lambda case: with_lmfit(case, guess(case))[:2],
    "lmfit, restarted": restarted,
    "lmfit, poor start": lambda case: with_lmfit(case, poor(case))[:2],
    "lmfit, from the truth": lambda case: with_lmfit(case, exact(case))[:2],
}


def compare(count: int, seed: int = 1) -> list[dict[str, str | float]]:
    """Run all methods on the same resonators; return one row a method."""
    rng = np.random.default_rng(seed)
    cases = [draw(rng) for _ in range(count)]
    rows: list[dict[str, str | float]] = []
    for name, method in METHODS.items():
        pulls = []
        inside = []
        times = []
        tried = cases[:SLOW] if method is restarted else cases
        for case in tried:
            begin = time.process_time()
            with np.errstate(all="ignore"):
                values, sd = method(case)
            times.append(time.process_time() - begin)
            pulls.append([(values[key] - case.truth[key]) / case.sd[key] for key in NAMES])
            inside.append([abs(values[key] - case.truth[key]) < sd[key] for key in NAMES[:2]])
        worst = np.max(np.abs(pulls), axis=1)
        good = worst < SUCCESS
        row: dict[str, str | float] = {
            "method": name,
            "resonators": len(tried),
            "success": float(np.mean(good)),
        }
        row |= {
            f"bias_{key}": float(b)
            for key, b in zip(NAMES, np.mean(np.array(pulls)[good], axis=0), strict=True)
        }
        row |= {
            f"rms_{key}": float(b)
            for key, b in zip(NAMES, np.std(np.array(pulls)[good], axis=0), strict=True)
        }
        row |= {
            f"coverage_{key}": float(b)
            for key, b in zip(NAMES[:2], np.mean(inside, axis=0), strict=True)
        }
        row |= {"time_mean": float(np.mean(times)), "time_median": float(np.median(times))}
        rows.append(row)
    return rows


def main() -> None:
    """Write duffing_fit.csv and print its main columns."""
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
    rows = compare(int(sys.argv[2]) if len(sys.argv) > 2 else 1000)
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / "duffing_fit.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)
    head = (
        f"{'method':24}{'count':>7}{'success':>9}{'bias α':>9}{'rms α':>9}{'68 % w':>9}"
        f"{'mean':>11}{'median':>11}"
    )
    body = [
        f"{row['method']:24}{row['resonators']:7d}{row['success']:9.1%}"
        f"{row['bias_alpha_ratio']:9.3f}{row['rms_alpha_ratio']:9.3f}"
        f"{row['coverage_linewidth']:9.1%}{1e3 * float(row['time_mean']):8.1f} ms"
        f"{1e3 * float(row['time_median']):8.1f} ms"
        for row in rows
    ]
    own = rows[0]
    peer = next(row for row in rows if row["method"] == "lmfit, restarted")
    ratio = float(peer["time_mean"]) / float(own["time_mean"])
    last = (
        f"lmfit, restarted until it meets the noise, takes {ratio:.0f} times as long and "
        f"succeeds in {float(peer['success']):.1%}"
    )
    sys.stdout.write("\n".join([head, *body, last, ""]))


if __name__ == "__main__":
    main()
