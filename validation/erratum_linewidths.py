"""The distance from the 1:2 ratio, counted in linewidths."""

from femnl.validation import Case, Reference

F11 = 1.466060e6
F22 = 2.932369e6
W11 = 135.0
W22 = 3.95

CASE = Case(
    claim="f22 − 2 f11 is 1.84 linewidths of (1,1) and 63 of (2,2)",
    source="arXiv:2502.19191, section Parametric effects (frequencies) and Fig. 1 (linewidths "
    "135 Hz and 3.95 Hz)",
    why="0.9 and 30.6 belong to f22/2 − f11 = 124.5 Hz, the detuning of a (1,1) drive from "
    "f22/2, not to f22 "
    "− 2 f11 "
    "= 249 Hz",
    references=(
        Reference("(f22 − 2 f11)/w11", 1.84, absolute=0.005, printed=0.9),
        Reference("(f22 − 2 f11)/w22", 63.0, absolute=0.5, printed=30.6),
        Reference("(f22/2 − f11)/w11", 0.92, absolute=0.005),
        Reference("(f22/2 − f11)/w22", 31.5, absolute=0.05),
    ),
    compute=lambda: [gap / width for gap in (F22 - 2 * F11, F22 / 2 - F11) for width in (W11, W22)],
)
