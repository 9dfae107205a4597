"""What a computation raises over numbers is a line for users, and a mistake stays one."""

import numpy as np
import pytest
import scipy.linalg
from scipy.optimize import least_squares

from femnl.core.errors import ConvergenceError, numbers_of

NAN = np.full((2, 2), np.nan)


def residuals(x: np.ndarray) -> np.ndarray:
    return x * np.nan


@pytest.mark.parametrize(
    "compute",
    [
        lambda: 1 / 0,
        lambda: 10.0**400,
        lambda: int(float("inf")),
        lambda: int(float("nan")),
        lambda: np.linalg.inv(np.zeros((2, 2))),
        lambda: scipy.linalg.svd(NAN),
        lambda: least_squares(residuals, np.ones(2)),
    ],
)
def test_errors_of_numbers_name_the_data(compute: object) -> None:
    assert callable(compute)
    with (
        pytest.raises(ConvergenceError, match="the computation breaks down"),
        numbers_of("a.nc"),
    ):
        compute()


@pytest.mark.parametrize(
    ("compute", "error"),
    [
        (lambda: np.ones(2) + np.ones(3), ValueError),
        (lambda: min([]), ValueError),
        (lambda: dict[str, int]()["gone"], KeyError),
    ],
)
def test_a_mistake_in_the_program_is_not_hidden(compute: object, error: type[Exception]) -> None:
    assert callable(compute)
    with pytest.raises(error), numbers_of("a.nc"):
        compute()
