"""Evidence by Laplace's method against nested sampling, on files of the virtual laboratory."""

from pathlib import Path

import numpy as np
import pytest
from dynesty.dynesty import NestedSampler

from femnl.diagnose.posing import pose
from femnl.effects import library
from femnl.fits.least_squares import FitResult, fit, log_prior
from femnl.io import measurement
from femnl.observe.extended import ExtendedModel
from femnl.pipeline import measured_device
from tests.blind.lab import Case, make

pytestmark = pytest.mark.slow
FAR = 8.0
"""Standard deviations around the best fit beyond which nothing is left of the likelihood, and
nested sampling need not look.
"""


def nested(result: FitResult) -> tuple[float, float]:
    """Return log ∫ likelihood × prior and its standard deviation, by nested sampling.

    The box of the integral holds the likelihood.
    """
    model = result.model
    low, high = model.bounds
    sd = np.sqrt(np.diag(result.covariance))
    start = np.maximum(low, result.vector - FAR * sd)
    end = np.minimum(high, result.vector + FAR * sd)

    def likelihood(vector: np.ndarray[tuple[int], np.dtype[np.float64]]) -> float:
        return float(-0.5 * np.sum(model.residuals(vector) ** 2)) + log_prior(model, vector, sd)

    sampler = NestedSampler(
        likelihood,
        lambda u: start + u * (end - start),
        len(start),
        nlive=150,
        sample="rslice",
        rstate=np.random.default_rng(1),
    )
    sampler.run_nested(dlogz=0.1, print_progress=False)
    return float(sampler.results.logz[-1] + np.sum(np.log(end - start))), float(
        sampler.results.logzerr[-1]
    )


@pytest.mark.parametrize(
    ("kind", "cause", "start"),
    [
        ("series", "gas_damping", {"per_pressure": 2e-6}),
        ("series", "thermal_stress", {"slope": 1e-6}),
        ("spectrum", "bending_stiffness", {"excess": 3e-13}),
        ("spectrum", "gas_loading", {"gas_density": 1e-3}),
    ],
)
def test_evidence_by_laplace_agrees_with_nested_sampling(
    kind: str, cause: str, start: dict[str, float], tmp_path: Path
) -> None:
    path = tmp_path / "file.nc"
    make(Case(kind, (cause,), 6, size=(10.0, 30.0)), path)
    tree = measurement.read(path)
    base_model = pose(kind, tree[kind].to_dataset(), measured_device(tree.attrs, path))
    base = fit(ExtendedModel(base_model), base_model.start)
    model = ExtendedModel(base_model, (library()[cause],))
    result = fit(model, np.append(base.vector, list(start.values())))
    value, error = nested(result)
    assert not result.stuck
    assert result.log_evidence == pytest.approx(value, abs=0.3 + 3 * error)
