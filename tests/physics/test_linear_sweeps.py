"""Sweeps of a mode that moves so little that it is linear: the commonest measurement of all."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from numpy.typing import NDArray
from scipy.signal import lfilter

from femnl import load
from femnl.core.diagnosis import Diagnosis
from femnl.diagnose import diagnose
from femnl.fits.response.first_fit import first_fit
from femnl.fits.response.pose import pose
from femnl.fits.response.single_sweeps import without_background
from femnl.io import measurement
from femnl.observe.film import SimulatedFilm
from tests.blind.linear_sweeps import make

F0 = 25405.0
WIDTH = 4.2
HEIGHT = 0.16
LEAK = 0.06 * np.exp(1.1j)
"""Resonance and leak by the drive, in V/V."""


@dataclass(frozen=True)
class Linear:
    """Sweeps upwards at each drive [V]; noise: by the signal of the strongest one; width [Hz]."""

    drives: tuple[float, ...] = (0.1,)
    leak: complex = 0.0
    noise: float = 1e-3
    seed: int = 1
    width: float = WIDTH

    @property
    def frequency(self) -> NDArray[np.float64]:
        """Of the drive [Hz]."""
        return np.linspace(F0 - 14 * self.width, F0 + 12 * self.width, 180)

    def data(self) -> xr.Dataset:
        """Return them as measured, by the whole equation of a driven oscillator."""
        rng = np.random.default_rng(self.seed)
        drives = np.array(self.drives)[:, None]
        f = self.frequency
        clear = F0 * self.width / (F0**2 - f**2 + 1j * f * self.width)
        clear = HEIGHT * np.exp(0.9j) * clear + self.leak
        sd = self.noise * HEIGHT * drives.max()
        noise = sd * rng.standard_normal((2, len(drives), len(self.frequency)))
        return measurement.response(
            np.broadcast_to(self.frequency, (len(drives), len(self.frequency))),
            drives * clear + noise[0] + 1j * noise[1],
            noise_sd=sd,
            mode="1,1",
            drive=drives[:, 0],
            direction=np.ones(len(drives)),
        )

    def diagnose(self, path: Path, *, alone: bool = False) -> Diagnosis:
        """Write them to a file, and diagnose it; with the base model alone where asked for."""
        bundle = measurement.bundle({"sweeps": self.data()}, geometry="square-270um")
        measurement.write(bundle, path)
        return diagnose(path, effects=[] if alone else None)


@pytest.mark.parametrize(
    ("drives", "seed"), [((0.1,), 1), ((0.1,), 3), ((0.025, 0.05, 0.1), 4), ((0.025, 0.05, 0.1), 5)]
)
def test_a_linear_mode_is_adequate_whichever_way_noise_bends_it(
    tmp_path: Path, drives: tuple[float, ...], seed: int
) -> None:
    # The noise of all but the second bends it downwards
    found = Linear(drives, seed=seed).diagnose(tmp_path / "a.nc", alone=True)
    assert found.verdict == "adequate", (found.p_value, found.where)
    assert found.parameters["base"]["frequency"].value == pytest.approx(F0, abs=0.02)
    assert found.parameters["base"]["linewidth"].value == pytest.approx(WIDTH, abs=0.02)


def test_a_linear_mode_that_a_gas_damps_is_adequate_far_from_its_resonance(tmp_path: Path) -> None:
    """Its Q is 63: there a rotating wave is off by 1/(4Q) of the height, four times the noise."""
    found = Linear(width=F0 / 63).diagnose(tmp_path / "a.nc", alone=True)
    assert found.verdict == "adequate", (found.p_value, found.where)
    assert found.parameters["base"]["linewidth"].value == pytest.approx(F0 / 63, rel=5e-3)


def test_a_smooth_misfit_is_no_noise_of_thousands_of_times_the_stated_one(tmp_path: Path) -> None:
    """A leak of a tenth of the resonance, ten points a linewidth and hardly any noise."""
    sweeps, truth = make(2893225275)
    assert truth["cause"] == "crosstalk"
    path = tmp_path / "a.nc"
    measurement.write(measurement.bundle({"sweeps": sweeps}, geometry="square-270um"), path)
    assert diagnose(path, effects=[]).verdict == "unexplained"


def test_noise_that_is_estimated_may_be_correlated_and_far_larger(tmp_path: Path) -> None:
    """Neighbours hardly differ in it, and so tell a sixth of it at first."""
    rho = 0.95
    linear = Linear((0.05, 0.1), noise=0.0)
    clear = linear.data()
    drawn = np.random.default_rng(3).standard_normal((4, 2000))
    noise = lfilter([np.sqrt(1 - rho**2)], [1, -rho], drawn, axis=1)[:, -clear.sizes["point"] :]
    noisy = clear.assign(
        real=clear["real"] + 1.6e-5 * noise[:2], imag=clear["imag"] + 1.6e-5 * noise[2:]
    )
    del noisy.attrs["noise_sd"]
    path = tmp_path / "a.nc"
    measurement.write(measurement.bundle({"sweeps": noisy}, geometry="square-270um"), path)
    assert diagnose(path, effects=[]).verdict == "adequate"


def test_no_sweeps_below_zero_hertz_are_offered() -> None:
    film = SimulatedFilm(load("square-270um"), 12)
    offered = []
    for width in (WIDTH, F0 / 63):
        model = pose(Linear(width=width).data(), film)
        start = dict(zip((spec.name for spec in model.base), model.start.tolist(), strict=True))
        offered.append(len(model.candidate_measurements([], start, [])))
    assert offered == [2, 1]


@pytest.mark.parametrize("noise", [pytest.param(1e-3, marks=pytest.mark.slow), 2e-5])
def test_a_leak_weaker_than_the_resonance_leads_no_linear_mode_astray(
    tmp_path: Path, noise: float
) -> None:
    found = Linear(leak=LEAK, noise=noise).diagnose(tmp_path / "a.nc")
    assert found.causes == ("crosstalk",), (found.verdict, found.where)
    assert found.parameters["crosstalk"]["real"].value == pytest.approx(LEAK.real, rel=1e-2)
    assert found.parameters["crosstalk"]["imag"].value == pytest.approx(LEAK.imag, rel=1e-2)
    assert found.parameters["base"]["frequency"].value == pytest.approx(F0, abs=0.02)


def test_a_first_fit_starts_a_linear_mode_within_what_noise_allows() -> None:
    _, plain = first_fit(Linear(seed=1).data(), ("",), None)
    assert plain["softens"] == 0
    assert plain["alpha_y"] > 0
    _, beside = first_fit(Linear(leak=LEAK).data(), ("",), None)
    assert beside["hidden"] == 1
    bent = Linear(leak=0.1 * HEIGHT * np.exp(4j)).data()
    assert without_background(bent, 1)["alpha_ratio"] < -1
    assert first_fit(bent, ("",), None)[1]["softens"] == 0
    assert beside["frequency"] == pytest.approx(F0, abs=0.02)
