"""What has been published on the devices of the report, each number with its source."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import pi, sqrt

PAPER = "Sommer et al. 2025, arXiv:2502.19191"


@dataclass(frozen=True)
class Drive:
    """A strongly driven fundamental mode.

    The laser's name and wavelength λ [m], and the fitted modulation z = S′ = 4πU/λ.
    """

    laser: str
    wavelength: float
    z: float


@dataclass(frozen=True)
class Published:
    """Published numbers of a device, by the mode's label or else by its number.

    frequency [Hz] measured; ratio f/f₁, and whether it was `measured` or `simulated`; ideal f/f₁ of
    a membrane without bending; alpha [m⁻²] from the published formula. drives: the published
    harmonic maps. highest: order of the highest harmonic that was seen above 1 % of the strongest
    one, None where none is named. remark: what the comparison means.
    """

    source: str
    frequency: dict[str, float]
    ratio: dict[str, float]
    ratio_kind: str
    ideal: dict[str, float]
    alpha: dict[str, float] = field(default_factory=dict)
    drives: tuple[Drive, ...] = ()
    highest: int | None = None
    remark: str = ""


@dataclass(frozen=True)
class Device:
    """A device of the report: its name, the geometries that model it, published numbers."""

    title: str
    geometries: tuple[str, ...]
    published: Published | None = None


def _numbered(values: Sequence[float]) -> dict[str, float]:
    return {str(k): value for k, value in enumerate(values, start=1)}


_ORDERS = [(m, n) for m in range(1, 5) for n in range(1, 5)]
_SQUARE = {f"({m},{n})": sqrt((m**2 + n**2) / 2) for m, n in _ORDERS} | {
    "(1,3)−(3,1)": sqrt(5),
    "(1,3)+(3,1)": sqrt(5),
}
_ALPHA = 3 * pi**2 / 16 * (250e9 / 1101.5e6) / 270e-6**2
# Eigenvalues of the Laplacian on the regular hexagon of side 1, held at its edge; 16π²/3 is exact.
_HEXAGON = (
    7.155339133926055,
    *[18.131677865531] * 2,
    *[32.4518575144] * 2,
    37.491352876798,
    47.629365773857,
    16 * pi**2 / 3,
    *[60.105112094] * 2,
)

SQUARE = Published(
    source=f"{PAPER}: frequencies in section Parametric effects, formula of α in section "
    "Membrane mechanics "
    "(S8), fits "
    "of maps in S7",
    frequency={"(1,1)": 1.466060e6, "(2,2)": 2.932369e6},
    ratio={"(2,2)": 2.932369e6 / 1.466060e6},
    ratio_kind="measured",
    ideal=_SQUARE,
    alpha={"(1,1)": _ALPHA, "(2,2)": 4 * _ALPHA},
    drives=(Drive("red", 632.8e-9, 8.85), Drive("green", 532e-9, 10.51)),
    highest=21,
    remark="The frequencies rest on an assumed density, which cannot change their ratio. "
    "Bending alone gives three "
    "times the "
    "measured detuning from 2:1, and free holes make it larger: what brings it down to 249 Hz "
    "is not in this model.",
)
HEXAGON = Published(
    source=f"{PAPER}: simulated ratios, measured frequency and fit of the maps in section "
    "Parametric effects (S9)",
    frequency={"1": 1.6858e6},
    ratio=_numbered((1.0, 1.5930, 1.5930, 2.1335, 2.1336, 2.2946, 2.5877, 2.7216, 2.9117, 2.9118)),
    ratio_kind="simulated",
    ideal=_numbered([sqrt(value / _HEXAGON[0]) for value in _HEXAGON]),
    drives=(Drive("red", 632.8e-9, 4.218),),
    remark="The published simulation lies above an ideal membrane by up to 0.47 %, growing with "
    "the frequency. Bending of the "
    "film as "
    "specified gives a fifth of that, and holes change little: what raises the published ratios "
    "is not in this model.",
)
DEVICES = (
    Device("Square membrane, device J10", ("square-270um", "square-270um-perforated"), SQUARE),
    Device("Hexagonal membrane", ("hexagon-278um", "hexagon-278um-perforated"), HEXAGON),
)
