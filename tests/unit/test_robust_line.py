"""What fits most data, whatever a few of them do."""

import numpy as np
import pytest

from femnl.core.robust import least_absolute


def test_one_level_is_the_median() -> None:
    data = np.random.default_rng(1).standard_normal(31)
    found = least_absolute(np.ones((31, 1)), data)
    np.testing.assert_allclose(found, abs(data - np.median(data)), atol=1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_data_far_off_leave_the_others_on_their_plane(seed: int) -> None:
    rng = np.random.default_rng(seed)
    columns = rng.standard_normal((40, 4))
    data = columns @ rng.standard_normal(4)
    data[:8] += 30
    found = least_absolute(columns, data)
    np.testing.assert_allclose(found[8:], 0, atol=1e-9)
    np.testing.assert_allclose(found[:8], 30, atol=1e-9)
