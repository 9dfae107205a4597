"""Where a driven Duffing mode falls from its upper branch, and where it turns vertical."""

from collections.abc import Iterator

import numpy as np
from scipy.optimize import bisect

from femnl.core.resonator import Resonator
from femnl.resonator import branches, critical_alpha, critical_point
from femnl.validation import Case, Reference

F0 = 1.466060e6
W = 135.0
MODE = Resonator(frequency=F0, quality_factor=F0 / W, alpha=5.76e9)


def compute() -> Iterator[float]:
    """Read the critical point, and the end of the upper branch at ten times its parameter."""
    force, _, amplitude = critical_point(MODE)
    peak = force / (MODE.omega * MODE.damping)
    yield MODE.alpha * peak**2 * MODE.quality_factor
    yield float(critical_alpha(F0, W, peak)) / MODE.alpha
    yield MODE.alpha * amplitude**2 * MODE.quality_factor

    def beyond(shift: float) -> float:
        # α_y/α_c grows as the square of the force.
        return 0.5 - float(
            np.count_nonzero(branches(MODE, np.sqrt(10) * force, [F0 + shift]).stable) == 2
        )

    jump = bisect(beyond, 900.0, 1200.0, xtol=1e-3)
    yield jump
    yield jump


CASE = Case(
    claim="A Duffing mode at α_y/α_c = 10 with w = 135 Hz jumps down 1039 Hz above f₀, where "
    "the paper saw it",
    source="Cleland, Foundations of Nanomechanics (2003): α_c = (32√3/27) w/(f₀ y_max²), so "
    "that the top of the "
    "backbone, "
    "(3/8) α_y y_max² f₀, lies at (4√3/9)·10·w; Lifshitz & Cross (2008): |A|² = (8√3/9)/(Qα) at "
    "the critical point; "
    "arXiv:2502.19191, comparison of red and green readout: jump around 1040 Hz",
    references=(
        Reference("α_c y_max² f₀/w", 32 * 3**0.5 / 27, relative=1e-12),
        Reference("α_c of the formula over α at the critical drive", 1.0, relative=1e-12),
        Reference("α Q |A|² at the critical point", 8 * 3**0.5 / 9, relative=1e-12),
        # The closed form is for w and the shift ≪ f₀, which leaves terms of the order of shift/f₀ =
        # 7e-4.
        Reference(
            "jump above f₀, top of the backbone", 4 * 3**0.5 / 9 * 10 * W, "Hz", relative=1e-3
        ),
        Reference("jump above f₀, measured", 1040.0, "Hz", absolute=5.0),
    ),
    compute=compute,
)
