"""The ratio of the two frequencies that the paper prints."""

from femnl.validation import Case, Reference

F11 = 1.466060e6
F22 = 2.932369e6

CASE = Case(
    claim="f22/f11 is 2.00017: the modes are 249 Hz from a 1:2 ratio",
    source="arXiv:2502.19191, section Parametric effects: its own f(1,1) = 1.466 060 MHz and "
    "f(2,2) = 2.932 369 MHz",
    why="2.0017 lost a zero; it would put f(2,2) 2.5 kHz above 2 f(1,1) where the paper's own "
    "frequencies are 249 "
    "Hz apart",
    references=(
        Reference("f22/f11", 2.00017, absolute=5e-6, printed=2.0017),
        Reference("f22 − 2 f11", 249.0, "Hz", absolute=0.5),
    ),
    compute=lambda: (F22 / F11, F22 - 2 * F11),
)
