"""A broad resonance of the piezo or the frame that the detector sees beside the mode."""

from dataclasses import replace

from femnl.core.effect import UNKNOWN, Effect, ParameterSpec, Values
from femnl.core.stages import Signal

_REASON = (
    "as strong as the resonance, or as all that is seen at the first place, or twice a background "
    "that is stronger than the resonance and hides it"
)


def shine_through(signal: Signal, values: Values) -> Signal:
    """Add C (w_p/2)/(f_p − f + iw_p/2) times the drive to the signal."""
    strength = values["real"] + 1j * values["imag"]
    half = values["width"] / 2
    pole = half / (values["offset"] - signal.detuning + 1j * half)
    return replace(signal, voltage=signal.voltage + strength * pole * signal.drive)


EFFECT = Effect(
    name="fano_background",
    accuracy=0.05,
    accuracy_reason="one resonance behind the mode; further ones are no constant",
    imitates={"response": {"crosstalk": 1.0, "group_delay": 0.69, UNKNOWN: 0.71}},
    equation="V → V + C (w_p/2)/(f_p − f + iw_p/2) V_drive",
    parameters=(
        ParameterSpec("real", "V/V", -1.0, 1.0, scale="slope", reason=_REASON),
        ParameterSpec("imag", "V/V", -1.0, 1.0, scale="slope", reason=_REASON),
        ParameterSpec(
            "offset",
            "Hz",
            -2.0,
            2.0,
            strength=False,
            scale="span",
            reason="f_p − f₀: from further away a resonance is a sloping background",
        ),
        ParameterSpec(
            "width",
            "Hz",
            0.05,
            4.0,
            strength=False,
            log=True,
            scale="span",
            reason="narrower than a twentieth of the sweeps it is a second mode and no background; "
            "wider than four times them it is a sloping background",
        ),
    ),
    changes={"signal": shine_through},
    source="U. Fano, Phys. Rev. 124, 1866 (1961): a narrow resonance beside a broad one that the "
    "same drive excites",
    limits="one broad resonance, linear in the drive, seen the same at all places; it does not "
    "push the mode",
    sentence="a broad resonance, as of the piezo, is seen beside the mode",
    shared=False,
    pointwise=True,
)
