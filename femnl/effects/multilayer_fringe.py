"""The fringe of the whole optical stack, seen by a focused beam, instead of one cosine."""

from dataclasses import replace

from femnl.core.effect import UNKNOWN, Effect, ParameterSpec, Values
from femnl.core.stages import Fringe
from femnl.optics.airy import Film, beam_waves


def reflect(fringe: Fringe, values: Values) -> Fringe:
    """Put the reflection of the stack with the given gap in place of the cosine."""
    if fringe.stack is None:
        return fringe
    film = Film(values["thickness"], values["index_scale"])
    axis, *beside = beam_waves(
        fringe.stack, fringe.wavelength, film, values["gap"], values["aperture_square"]
    )
    return replace(
        fringe,
        coefficients=axis.coefficients,
        wavelength=axis.wavelength,
        beside=tuple(beside),
    )


EFFECT = Effect(
    name="multilayer_fringe",
    accuracy=0.01,
    accuracy_reason="flat layers of known indices, and a beam without aberrations",
    imitates={"map": {"one_sided_saturation": 0.72, UNKNOWN: 0.02}, "trace": {UNKNOWN: 0.18}},
    equation="f(u) = R(gap + u) of the stack, R = Σ_k Re c_k e^{4πik(gap + u)/λ}, "
    "c_k → c_k/(1 + ik gap/z_R) under a beam of z_R = λ/(πNA²)",
    parameters=(
        ParameterSpec(
            "gap",
            "m",
            0.94,
            1.06,
            strength=False,
            scale="stack",
            reason="a sacrificial layer is grown to a few per cent; fringes tell the gap modulo "
            "λ/2 alone, and a wider range would hold the same gap again",
        ),
        ParameterSpec(
            "thickness",
            "m",
            0.9,
            1.1,
            strength=False,
            scale="film",
            reason="ellipsometry and the wafer's uniformity leave a few per cent, a release etch "
            "takes some more; beyond a tenth the film is another one",
        ),
        ParameterSpec(
            "index_scale",
            "1",
            0.95,
            1.09,
            strength=False,
            reason="n of LPCVD silicon nitride is 1.98 to 2.2 at 633 nm, from stoichiometric to "
            "silicon-rich (Philipp 1973: 2.01; Luke et al., Opt. Lett. 40, 4823 (2015): 2.04)",
        ),
        ParameterSpec(
            "aperture_square",
            "1",
            0.0,
            0.03,
            strength=False,
            reason="NA = λ/(πw₀) up to 0.17, a waist of 1.2 µm at 633 nm: a beam into a wider cone "
            "is no Gaussian one, as it fills the objective",
        ),
    ),
    changes={"fringe": reflect},
    source="characteristic matrix of each layer at normal incidence (Born & Wolf, Principles of "
    "Optics); focus: overlap of a Gaussian beam with itself after a way 2kd, 1/(1 + ikd/z_R); "
    "Sommer et al., arXiv:2502.19191, S6",
    limits="fringe right to 1e-3 of its contrast up to gap = z_R/2; gap known modulo half a "
    "wavelength, and to first order only together with the focus, which turns the fringe by "
    "gap/z_R: where the focus is not told, its error holds that range; which way the film moves is "
    "taken from the drive's phase; beams of several wavelengths have one NA",
    sentence="the fringe is the reflection of the whole optical stack and not one cosine",
    needs=("stack", "film"),
    replaces=("theta",),
)
