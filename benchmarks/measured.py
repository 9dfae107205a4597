"""What the diagnosis says of measured and published numbers: `python -m benchmarks.measured`.

The square membrane needs the open spectrum sin-square-rad9-21.nc beside the repository, and is left
out where it is not there. The hexagon's ten ratios are those that arXiv:2502.19191 prints in its
supplement, taken as data with the error of their rounding.
"""

import sys
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from femnl import load, solve_modes
from femnl.core.device import Clamp
from femnl.core.diagnosis import Diagnosis
from femnl.diagnose import diagnose
from femnl.io import measurement

SQUARE = Path(__file__).parents[2] / "shared" / "data" / "sin-square-rad9-21.nc"
RATIOS = np.array([1.0, 1.5930, 1.5930, 2.1335, 2.1336, 2.2946, 2.5877, 2.7216, 2.9117, 2.9118])
FIRST = 1.6858e6  # Hz
# Standard deviation of a number printed to four decimals; the first ratio is exact
ROUNDING = 1e-4 / np.sqrt(12)


def square() -> Diagnosis | None:
    """The nine modes of a silicon nitride square, if the file is there."""
    return diagnose(SQUARE) if SQUARE.exists() else None


def square_by_hand() -> None:
    """χ² of the nine modes by weighted least squares.

    Speed of waves and bending, then with unequal stresses and an edge that yields.
    """
    data = measurement.read(SQUARE)["spectrum"].to_dataset()
    order = np.array(
        [[int(number) for number in str(label).split(",")] for label in data.label.values]
    )
    device = load("square-700um")
    rigid, springy = (
        solve_modes(m, 11, resolution=0.6).frequency
        for m in (device, replace(device, clamp=Clamp(normal=3e10, shear=3e10)))
    )
    places = [
        {
            (1, 1): 0,
            (1, 2): 1,
            (2, 1): 2,
            (2, 2): 3,
            (1, 3): 4,
            (3, 1): 5,
            (3, 2): 6,
            (2, 3): 7,
            (3, 3): 10,
        }[m, n]
        for m, n in order
    ]
    even = rigid[places]
    weight = rigid[places] / data.frequency_sd.values
    squares = np.sum(order**2, axis=1)
    columns = {
        "speed and bending": np.stack([np.ones(len(order)), squares]),
        "unequal stresses": ((order[:, 0] ** 2 - order[:, 1] ** 2) / squares)[None],
        "an edge that moves inwards": (springy[places] / even)[None],
    }
    used = np.empty((0, len(order)))
    for name, column in columns.items():
        used = np.concatenate([used, column])
        misfit = np.linalg.lstsq((used * weight).T, (data.frequency.values / even - 1) * weight)[1]
        sys.stdout.write(
            f"  χ² = {misfit[0]:.5g} with {name}{' as well' if len(used) > 2 else ''}, to "
            "first order\n"
        )


def hexagon(geometry: str = "hexagon-278um") -> Diagnosis:
    """The ten ratios of the hexagonal device against one of the shipped geometries."""
    sd = np.where(np.arange(len(RATIOS)) > 0, ROUNDING, 1e-7) * FIRST
    with TemporaryDirectory() as folder:
        path = Path(folder) / "hexagon.nc"
        tree = measurement.bundle(
            {"spectrum": measurement.spectrum(RATIOS * FIRST, sd)}, geometry=geometry
        )
        measurement.write(tree, path)
        return diagnose(path)


def tell(name: str, found: Diagnosis) -> None:
    """Print verdict, parameters and what was tried."""
    out = sys.stdout.write
    out(
        f"{name}: {found.verdict} {', '.join(found.causes)} (p = {found.p_value:.2g})\n  "
        f"{found.where}\n"
    )
    for owner, parameters in found.parameters.items():
        for key, p in parameters.items():
            out(f"  {owner} {key} = {p.value:.6g} ± {p.sd:.2g} {p.unit}\n")
    out(
        f"  χ² per degree of freedom {found.before.chi2_reduced:.4g}, held out "
        f"{found.before.heldout_chi2_reduced:.4g} per mode\n"
    )
    for trial in sorted(found.trials, key=lambda t: t.chi2)[:8]:
        against = "".join(f"; {reason}" for reason in trial.against)
        out(f"  χ² = {trial.chi2:.4g} with {', '.join(trial.causes) or 'no cause'}{against}\n")
    for form in found.free_forms:
        after = (
            f"χ² per degree of freedom {form.quality.chi2_reduced:.4g}, held out "
            f"{form.quality.heldout_chi2_reduced:.4g} per mode"
        )
        out(f"  {form.sentence} ({form.n_parameters} parameters): {after}\n")


def main() -> None:
    """Diagnose all of it."""
    found = square()
    if found is None:
        sys.stdout.write(
            f"the square is left out: {SQUARE.name} is not beside the repository, in shared/data\n"
        )
    else:
        tell("square membrane", found)
        square_by_hand()
    tell("hexagon's ten ratios", hexagon())


if __name__ == "__main__":
    main()
