"""What `femnl modes` tells beside frequencies and Duffing coefficients.

In-plane inertia, a bow, dissipation dilution, quality factors.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from femnl.cli._output import console, scientific, table
from femnl.core.errors import MeasurementError, ParameterError

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np
    from numpy.typing import NDArray

    from femnl.core.device import Lamina, Model
    from femnl.core.modes import Modes
    from femnl.core.nonlinearity import Nonlinearity
    from femnl.mechanics.modes.quality import Quality
    from femnl.mechanics.nonlinearity import Inertia
    from femnl.mechanics.static_deflection import StaticDeflection

DIGITS = 6


@dataclass(frozen=True)
class Wishes:
    """What the options ask for beside frequencies.

    bow: depth or pressure, see `bow_of`. pressure [Pa]: of the gas that takes part of Q.
    """

    inertia: bool
    bow: tuple[float | None, float | None] | None
    dilution: bool
    quality: bool
    pressure: float

    @property
    def any(self) -> bool:
        """Whether they ask for anything."""
        return self.inertia or self.bow is not None or self.dilution or self.quality

    def refuse(self, model: Model) -> None:
        """Refuse what a device does not have, before its modes are solved.

        Raises: ParameterError.
        """
        if self.bow is not None:
            from femnl.mechanics.static_deflection import refuse_rest

            refuse_rest(model, *self.bow)
        if self.dilution:
            from femnl.mechanics.modes.dilution import refuse_without_bending

            refuse_without_bending(model)
        if self.quality:
            from femnl.mechanics.modes.quality import refuse_unknown_loss

            refuse_unknown_loss(model)


@dataclass(frozen=True)
class More:
    """Results that were asked for, None for the others. dilution: Q/Q_bend and its error."""

    inertia: Inertia | None
    bowed: StaticDeflection | None
    dilution: tuple[NDArray[np.float64], NDArray[np.float64]] | None
    quality: Quality | None

    @classmethod
    def solve(
        cls,
        modes: Modes,
        wishes: Wishes,
        tensor: bool,
    ) -> More:
        """Solve what the options ask for."""
        from femnl.mechanics.modes.dilution import dilution
        from femnl.mechanics.modes.quality import solve_quality
        from femnl.mechanics.nonlinearity import solve_inertia
        from femnl.mechanics.static_deflection import solve_static_deflection

        return cls(
            solve_inertia(modes, cross=tensor) if wishes.inertia else None,
            solve_static_deflection(modes, *wishes.bow) if wishes.bow is not None else None,
            dilution(modes) if wishes.dilution else None,
            solve_quality(modes, wishes.pressure) if wishes.quality else None,
        )

    def record(self) -> dict[str, Any]:
        """Return the result as plain values for JSON, in SI."""
        found: dict[str, Any] = {}
        if self.inertia is not None:
            found["inertia"] = {
                name: getattr(self.inertia, name)
                for name in ("change", "change_error", "cross", "cross_error")
            }
        if self.bowed is not None:
            names = (
                "depth",
                "frequency",
                "stiffness",
                "k2",
                "k3",
                "alpha",
                "frequency_error",
                "k2_error",
                "k3_error",
                "alpha_error",
            )
            found["bow"] = {name: getattr(self.bowed, name) for name in names}
        if self.dilution is not None:
            found["dilution"] = {"factor": self.dilution[0], "error": self.dilution[1]}
        if self.quality is not None:
            parts = (
                "total",
                "low",
                "high",
                "intrinsic",
                "dilution",
                "dilution_error",
                "gas",
                "lost",
            )
            found["quality"] = {name: getattr(self.quality, name) for name in parts}
        return found

    def show(self, modes: Modes, nonlinearity: Nonlinearity) -> None:
        """Print a table for each."""
        names = [
            [str(number), label or "–"]
            for number, label in zip(modes.number, modes.label, strict=True)
        ]
        if self.inertia is not None:
            rows = [
                [
                    *name,
                    scientific(alpha * (1 + change) * 1e-12, DIGITS),
                    f"{change * 100:.5f} %".replace("-", "−"),
                    f"{error * 100:.0e} %",
                ]
                for name, alpha, change, error in zip(
                    names,
                    nonlinearity.alpha,
                    self.inertia.change,
                    self.inertia.change_error,
                    strict=True,
                )
            ]
            title = "With in-plane inertia, which follows the stretching at twice the frequency"
            console().print(table(title, ["mode", "label", "α (µm⁻²)", "change", "±"], rows))
            if self.inertia.cross is not None:
                cross = [
                    [n[0], *(f"{c * 100:.4f}".replace("-", "−").replace("nan", "–") for c in r)]
                    for n, r in zip(names, self.inertia.cross, strict=True)
                ]
                title = "Change of the cubic force on mode i per q_i q_j² by in-plane inertia, %"
                console().print(table(title, ["i\\j", *(n[0] for n in names)], cross))
        flat = ""
        if self.bowed is not None:
            self._show_bow(self.bowed, names)
            # A bent film stretches as it moves, which may lose more
            flat = "Of the flat film: "
        if self.quality is not None:
            _show_quality(self.quality, names, modes.domain.model.layers, flat)
        if self.dilution is not None:
            rows = [
                [*name, f"{q:.1f}", f"{error / q:.0e}"]
                for name, q, error in zip(names, *self.dilution, strict=True)
            ]
            console().print(
                table(
                    f"{flat}Dissipation dilution: Q over that of bending alone; ± is relative",
                    ["mode", "label", "Q/Q_bend", "±"],
                    rows,
                )
            )

    @staticmethod
    def _show_bow(bowed: StaticDeflection, names: list[list[str]]) -> None:
        rows = [
            [
                *name,
                f"{bowed.frequency[k] / 1e6:.6f}",
                scientific(bowed.alpha[k] * 1e-12, DIGITS - 1).replace("-", "−"),
                scientific(bowed.k2[k], DIGITS - 1).replace("-", "−"),
                scientific(bowed.k3[k], DIGITS - 1),
                f"{bowed.frequency_error[k] / bowed.frequency[k]:.0e}",
                f"{abs(bowed.alpha_error[k] / bowed.alpha[k]):.0e}",
            ]
            for k, name in enumerate(names)
        ]
        title = (
            f"Bent at rest by {bowed.depth * 1e9:.6g} nm at most; α is that of motion at f; "
            "± are relative"
        )
        console().print(
            table(
                title,
                ["mode", "label", "f (MHz)", "α (µm⁻²)", "k₂ (N/m²)", "k₃ (N/m³)", "±f", "±α"],
                rows,
            )
        )


def _show_quality(
    quality: Quality, names: list[list[str]], layers: Sequence[Lamina], flat: str
) -> None:
    """Print Q with its parts and bounds; with layers, which part of the loss is theirs."""
    shares = quality.lost[1:].T * 100
    rows = [
        [
            *name,
            scientific(quality.total[k], 3),
            f"{scientific(quality.low[k], 2)} … {scientific(quality.high[k], 2)}",
            scientific(quality.dilution[k], DIGITS),
            f"{quality.dilution_error[k] / quality.dilution[k]:.0e}",
            "–" if quality.gas[k] == float("inf") else scientific(quality.gas[k], 3),
            *(f"{share:.3g} %" for share in shares[k]),
        ]
        for k, name in enumerate(names)
    ]
    mean, low, high = quality.intrinsic
    law = "Σ sᵢ/Qᵢ" if layers else "1/(Q_int D)"
    title = (
        f"{flat}1/Q = {law} + 1/Q_gas, Q_int = {mean:.0f} ({low:.0f} … {high:.0f}), without sound "
        "into the chip; ± of D is relative"
    )
    columns = ["mode", "label", "Q", "1 σ of β", "D", "±D", "Q_gas"]
    columns += [f"lost in {lamina.name}" for lamina in layers]
    console().print(table(title, columns, rows))


def pressure_of(words: str) -> float:
    """Return the pressure [Pa] that words such as "1e-6 mbar" mean. Raises: ParameterError."""
    pressure = _quantity(words, "Pa", "--pressure")
    if pressure < 0:
        raise ParameterError(f'--pressure "{words}": expected 0 or more')
    return pressure


def frequency_of(words: str) -> float:
    """Return the frequency [Hz] that words such as "1.45 MHz" mean. Raises: ParameterError."""
    frequency = _quantity(words, "Hz", "--near")
    if frequency <= 0:
        raise ParameterError(f'--near "{words}": expected a frequency above 0')
    return frequency


def _quantity(words: str, unit: str, option: str) -> float:
    from femnl.io.measurement import quantity

    try:
        return quantity(words, unit, option)[0]
    except MeasurementError as error:
        raise ParameterError(str(error)) from None


def bow_of(words: str) -> tuple[float | None, float | None]:
    """Return the depth [m] or the pressure [Pa] that words such as "100 nm" or "10 Pa" mean.

    Neither for "layers", the stresses of which bend the film. Raises: ParameterError.
    """
    from femnl.io.measurement import quantity

    if words.strip() == "layers":
        return None, None
    number = words.strip()[-1:].isdigit()  # what has no unit may be either
    for place, unit in enumerate(() if number else ("m", "Pa")):
        try:
            value = quantity(words, unit, "--bow")[0]
        except MeasurementError:
            continue
        return (value, None) if place == 0 else (None, value)
    raise ParameterError(
        f'--bow "{words}": expected the depth of the bow, such as "100 nm", or the pressure that '
        'makes it, such as "10 Pa", or the word layers'
    )
