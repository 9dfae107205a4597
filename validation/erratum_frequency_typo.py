"""Where the range of well-defined harmonics begins in the text on their phases."""

from femnl.validation import Case, Reference

CASE = Case(
    claim="The range of well-defined phases begins at 1.6922 MHz",
    source="arXiv:2502.19191, section Nonlinear readout model: a range of about 150 Hz that "
    "ends at the jump at "
    "1.6924 MHz",
    why="1.9925 MHz is 300 kHz above the jump at which the range ends; 150 Hz below the jump is "
    "1.6922(5) MHz",
    references=(
        Reference("start of the range", 1.6922e6, "Hz", absolute=0.0001e6, printed=1.9925e6),
    ),
    compute=lambda: (1.6924e6 - 150.0,),
)
