"""`femnl modes GEOMETRY`: frequencies, effective masses and Duffing coefficients."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from femnl.cli._device import (
    Bending,
    Cache,
    Count,
    EdgeOption,
    Geometry,
    Json,
    Resolution,
    Symmetry,
    load_device,
    suffix_of,
)
from femnl.cli._modes_more import More, Wishes, bow_of, frequency_of, pressure_of
from femnl.cli._output import console, note, print_json, scientific, table
from femnl.core.choices import Certified
from femnl.core.errors import ParameterError
from femnl.io.results.atomic import need_room

if TYPE_CHECKING:
    from femnl.core.device import Model
    from femnl.core.modes import Modes
    from femnl.core.nonlinearity import Nonlinearity

Out = Annotated[
    Path | None,
    typer.Option(
        help="Also write the modes to a file: .nc, or .vtu for ParaView.", show_default=False
    ),
]
Tolerance = Annotated[
    float | None,
    typer.Option(
        help="Relative error of every f and f/f₁ to be reached; sets degree and resolution.",
        show_default=False,
    ),
]
Of = Annotated[
    Certified | None,
    typer.Option(
        "--tolerance-of",
        help="What is to reach the tolerance: all takes in m_eff, α and k₃.",
        show_default="frequency",
    ),
]
Homogenised = Annotated[
    bool,
    typer.Option(
        "--homogenised",
        help="Take a rectangular array of holes as an even film: seconds for any number of holes.",
    ),
]
Tensor = Annotated[
    bool, typer.Option("--tensor", help="Couplings between modes too: their full cubic tensor.")
]
Inertia = Annotated[
    bool,
    typer.Option(
        "--inertia",
        help="What the film's inertia in its plane changes of α; of couplings with --tensor.",
    ),
]
Bow = Annotated[
    str | None,
    typer.Option(
        help='A bow at rest: "100 nm" in the shape of mode 1, "10 Pa" of pressure, or layers, '
        "by the stresses of its layers.",
        show_default=False,
    ),
]
Dilution = Annotated[
    bool, typer.Option("--dilution", help="Dissipation dilution: Q over that of bending alone.")
]

Quality = Annotated[
    bool,
    typer.Option(
        "--q", help="Quality factors, of the film's material, tension and gas, with their bounds."
    ),
]
Pressure = Annotated[
    str | None,
    typer.Option(help='Of the gas that takes part of Q, such as "1e-6 mbar".', show_default=False),
]
Near = Annotated[
    str | None,
    typer.Option(
        help='The modes nearest to a frequency such as "1.45 MHz", without those below them.',
        show_default=False,
    ),
]


def command(
    geometry: Geometry,
    *,
    count: Count = 10,
    near: Near = None,
    edge: EdgeOption = None,
    bending: Bending = None,
    tensor: Tensor = False,
    symmetry: Symmetry = "auto",
    resolution: Resolution = 1.0,
    tolerance: Tolerance = None,
    tolerance_of: Of = None,
    homogenised: Homogenised = False,
    inertia: Inertia = False,
    bow: Bow = None,
    dilution: Dilution = False,
    quality: Quality = False,
    pressure: Pressure = None,
    out: Out = None,
    cache: Cache = True,
    as_json: Json = False,
) -> None:
    """Solve the modes of a device: frequencies, effective masses, Duffing coefficients."""
    kind = suffix_of(out, (".nc", ".vtu")) if out else ""
    if out:
        need_room(out)
    wishes = _wishes(inertia, bow, dilution, quality, pressure)
    target = None if near is None else frequency_of(near)
    if target is not None and bow is not None:
        raise ParameterError(
            "--bow: modes of a bent film follow from the lowest ones; leave out --near, and give "
            "a --count that reaches them"
        )
    if homogenised and kind == ".vtu":
        raise ParameterError(
            f"{out}: the even film has no stress around holes to show; leave out --homogenised, "
            "or write a .nc"
        )
    if homogenised:
        meshed = (tolerance, tolerance_of, resolution, symmetry) != (None, None, 1.0, "auto")
        _refuse_for_an_even_film(meshed, wishes, target)
    _refuse_tolerance(tolerance, tolerance_of, resolution, target)
    model = load_device(geometry, bending, edge)
    wishes.refuse(model)
    from femnl.pipeline import solve_nonlinearity

    if homogenised:
        from femnl.mechanics.lattice import solve_homogenised

        modes, nonlinearity = solve_homogenised(model, count, tensor=tensor)
    else:
        modes = _solve(
            model,
            count,
            near=target,
            symmetry=symmetry,
            resolution=resolution,
            tolerance=tolerance,
            of=tolerance_of,
            cache=cache,
        )
        nonlinearity = solve_nonlinearity(modes, tensor=tensor, cache=cache)
    more = More.solve(modes, wishes, tensor)
    if as_json:
        print_json(_record(modes, nonlinearity) | more.record())
    else:
        _show(modes, nonlinearity)
        more.show(modes, nonlinearity)
    if out:
        from femnl.io.results.netcdf import write_modes
        from femnl.io.results.vtu import write_vtu

        if kind == ".nc":
            write_modes(out, modes, nonlinearity)
        else:
            write_vtu(out, modes)
        note(f"wrote {out}")


def _wishes(
    inertia: bool, bow: str | None, dilution: bool, quality: bool, pressure: str | None
) -> Wishes:
    """Return what is asked for beside frequencies, read from the words of the command line."""
    if pressure is not None and not quality:
        raise ParameterError(f"--pressure {pressure}: gas takes part of Q; ask for it with --q")
    return Wishes(
        inertia,
        None if bow is None else bow_of(bow),
        dilution,
        quality,
        0.0 if pressure is None else pressure_of(pressure),
    )


def _refuse_for_an_even_film(meshed: bool, wishes: Wishes, target: float | None) -> None:
    """An even film in the place of the holes has neither a mesh to choose nor all results."""
    if meshed:
        unfit = "--tolerance, --tolerance-of, --resolution and --symmetry"
        raise ParameterError(
            f"--homogenised: the even film has a mesh of its own; leave out {unfit}"
        )
    if wishes.any or target is not None:
        raise ParameterError(
            "--homogenised: the even film tells nothing of --inertia, --bow, --dilution, --q or "
            "--near; solve the full film for them"
        )


def _refuse_tolerance(
    tolerance: float | None, of: Certified | None, resolution: float, target: float | None
) -> None:
    """A tolerance needs the lowest modes, and sets the resolution itself."""
    if target is not None and (tolerance is not None or of is not None):
        raise ParameterError(
            "--near: no tolerance is reached there; leave out --tolerance, and raise "
            "--resolution for smaller errors"
        )
    if tolerance is None and of is not None:
        raise ParameterError(
            f"--tolerance-of {of}: there is no tolerance to reach; give one with --tolerance"
        )
    if tolerance is not None and resolution != 1.0:
        raise ParameterError(
            f"--resolution {resolution:g}: a tolerance sets the resolution; give one of the two"
        )


def _solve(
    model: Model,
    count: int,
    *,
    near: float | None,
    symmetry: str,
    resolution: float,
    tolerance: float | None,
    of: Certified | None,
    cache: bool,
) -> Modes:
    from femnl.pipeline import solve_modes, solve_modes_near, solve_modes_to

    if near is not None:
        return solve_modes_near(model, near, count, symmetry, resolution, cache)
    if tolerance is None:
        return solve_modes(model, count, symmetry, resolution, cache)
    return solve_modes_to(model, tolerance, count, symmetry, cache, of or "frequency")


def _record(modes: Modes, nonlinearity: Nonlinearity) -> dict[str, Any]:
    columns = zip(
        modes.number,
        modes.label,
        modes.frequency,
        modes.ratio,
        modes.effective_mass,
        nonlinearity.k3,
        nonlinearity.alpha,
        strict=True,
    )
    names = ("number", "label", "frequency", "ratio", "effective_mass", "k3", "alpha")
    record: dict[str, Any] = {
        "geometry": modes.domain.model.name,
        "modes": [dict(zip(names, row, strict=True)) for row in columns],
        "errors": {
            "frequency": modes.frequency_error,
            "ratio": modes.ratio_error,
            "effective_mass": modes.effective_mass_error,
            "k3": nonlinearity.k3_error,
            "alpha": nonlinearity.alpha_error,
        },
        "edge": nonlinearity.edge,
        "bending": modes.domain.model.bending,
    }
    if nonlinearity.tensor is not None:
        record["tensor"] = nonlinearity.tensor
        record["errors"]["tensor"] = nonlinearity.tensor_error
    return record


SLOW = 1e4
"""Highest frequency [Hz] below which all are printed in Hz."""


def _show(modes: Modes, nonlinearity: Nonlinearity) -> None:
    model = modes.domain.model
    # Modes of a few kilohertz and less in Hz, where six decimals of MHz hold nothing
    divisor, unit = (1e6, "MHz") if modes.frequency[-1] >= SLOW else (1.0, "Hz")
    columns = {
        "mode": [str(number) for number in modes.number],
        "label": [label or "–" for label in modes.label],
        f"f ({unit})": [f"{f / divisor:.6f}" for f in modes.frequency],
        "f/f₁": [f"{ratio:.6f}" for ratio in modes.ratio],
        "m_eff (ng)": [f"{mass * 1e12:.5g}" for mass in modes.effective_mass],
        "α (µm⁻²)": [scientific(alpha * 1e-12, 5) for alpha in nonlinearity.alpha],
        "k₃ (N/m³)": [scientific(k3, 5) for k3 in nonlinearity.k3],
    }
    if modes.coarse is not None:
        errors = {
            "±f": modes.frequency_error / modes.frequency,
            "±f/f₁": modes.ratio_error / modes.ratio,
            "±m_eff": modes.effective_mass_error / modes.effective_mass,
            "±α": nonlinearity.alpha_error / nonlinearity.alpha,
            "±k₃": nonlinearity.k3_error / nonlinearity.k3,
        }
        columns |= {name: [f"{e:.0e}" for e in error] for name, error in errors.items()}
    if modes.first > 1:  # without the lowest mode there is no ratio to it
        columns = {name: column for name, column in columns.items() if "f/f₁" not in name}
    title = (
        f"{model.name}, in-plane edge {nonlinearity.edge}, "
        f"{'with' if model.bending else 'without'} bending; "
    )
    title += "± are relative" if modes.coarse else "an even film in the place of the holes"
    rows = [list(row) for row in zip(*columns.values(), strict=True)]
    console().print(table(title, list(columns), rows))
    if nonlinearity.tensor is not None:
        n = len(modes.frequency)
        numbers = [str(number) for number in modes.number]
        cross = [
            [number, *(scientific(3 * nonlinearity.tensor[i, i, j, j], 4) for j in range(n))]
            for i, number in enumerate(numbers)
        ]
        for i in range(n):
            cross[i][i + 1] = scientific(nonlinearity.tensor[i, i, i, i], 4)
        console().print(
            table(
                "Cubic force on mode i per q_i q_j² (diagonal: q_i³), N/m³",
                ["i\\j", *numbers],
                cross,
            )
        )
