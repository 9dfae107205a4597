"""Fisher matrices for every size of a discrepancy, beside plain linear algebra."""

import numpy as np
import pytest

from femnl.diagnose.discrepancy import Information

SCATTER = np.array([1.0, 10.0, 1e6])
SMOOTH = np.array([1.0, 5.0, 1e8])


@pytest.mark.parametrize("strength", [1.0, 1e3])
@pytest.mark.parametrize("n_directions", [0, 2, 9])
def test_one_decomposition_for_each_scatter_does_for_all_sizes_of_the_smooth_part(
    n_directions: int, strength: float
) -> None:
    rng = np.random.default_rng(1)
    columns = strength * rng.normal(size=(50, 6))
    columns[:, 5] = columns[:, 4]  # two causes that do the same
    inside = strength * rng.normal(size=(n_directions, 6))
    seen = rng.normal(size=n_directions)
    pull = columns.T @ rng.normal(size=50) / SCATTER[:, None]
    own = columns.T @ columns / SCATTER[:, None, None] + np.diag([12.0] * 4 + [1.0] * 2)
    found = Information(own, inside)
    determinant = found.log_determinant(SMOOTH)
    taken = found.taken(pull, seen, SMOOTH)
    for i, smooth in enumerate(SMOOTH):
        for j in range(len(SCATTER)):
            fisher = own[j] + inside.T @ inside / smooth
            gradient = pull[j] + inside.T @ seen / smooth
            assert determinant[i, j] == pytest.approx(np.linalg.slogdet(fisher)[1], rel=1e-9)
            assert taken[i, j] == pytest.approx(
                gradient @ np.linalg.solve(fisher, gradient), rel=1e-8
            )
            np.testing.assert_allclose(
                found.variance(smooth, j), np.diag(np.linalg.inv(fisher)), rtol=1e-7
            )
