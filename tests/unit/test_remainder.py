"""The error of a number that three degrees do not show to converge.

Tested on numbers that no constant of the code enters.
"""

import numpy as np

from femnl.core.discretisation_error import remainder


def test_differences_that_do_not_fall_leave_three_times_the_last_one() -> None:
    fine, coarse, coarsest = (np.array([1.0, 2.0]) + shift for shift in (0.0, 1e-4, 0.0))
    np.testing.assert_allclose(
        remainder([fine, coarse, coarsest], np.ones(2), 0.1), 3e-4, rtol=1e-6
    )


def test_two_approximations_alone_leave_three_times_their_difference() -> None:
    fine = np.array([1.0, 2.0])
    coarse = np.array([1.0, 2.0]) + 1e-4
    np.testing.assert_allclose(remainder([fine, coarse], np.ones(2), 0.1), 3e-4, rtol=1e-6)
