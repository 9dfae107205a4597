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
from femnl.cli._modes_more import More, bow_of
from femnl.cli._output import console, note, print_json, scientific, table
from femnl.core.choices import Certified
from femnl.core.errors import ParameterError

if TYPE_CHECKING:
    from femnl.core.device import Model
    from femnl.core.mechanics import Modes, Nonlinearity

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
        help='A bow at rest: "100 nm" in the shape of mode 1, or "10 Pa" of pressure.',
        show_default=False,
    ),
]
Dilution = Annotated[
    bool, typer.Option("--dilution", help="Dissipation dilution: Q over that of bending alone.")
]


def command(
    geometry: Geometry,
    *,
    count: Count = 10,
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
    out: Out = None,
    cache: Cache = True,
    as_json: Json = False,
) -> None:
    """Solve the modes of a device: frequencies, effective masses, Duffing coefficients."""
    from femnl.io.results.atomic import need_room
    from femnl.pipeline import solve_nonlinearity

    kind = suffix_of(out, (".nc", ".vtu")) if out else ""
    if out:
        need_room(out)
    rest = None if bow is None else bow_of(bow)
    model = load_device(geometry, bending, edge)
    if homogenised:
        if (
            tolerance is not None
            or tolerance_of is not None
            or resolution != 1.0
            or symmetry != "auto"
        ):
            unfit = "--tolerance, --tolerance-of, --resolution and --symmetry"
            raise ParameterError(
                f"--homogenised: the even film has a mesh of its own; leave out {unfit}"
            )
        if inertia or bow is not None or dilution:
            raise ParameterError(
                "--homogenised: the even film tells nothing of --inertia, --bow or --dilution; "
                "solve the full film for them"
            )
        from femnl.mechanics.lattice import solve_homogenised

        modes, nonlinearity = solve_homogenised(model, count, tensor=tensor)
    else:
        modes = _solve(
            model,
            count,
            symmetry=symmetry,
            resolution=resolution,
            tolerance=tolerance,
            of=tolerance_of,
            cache=cache,
        )
        nonlinearity = solve_nonlinearity(modes, tensor=tensor, cache=cache)
    more = More.solve(modes, inertia, rest, dilution, tensor)
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


def _solve(
    model: Model,
    count: int,
    *,
    symmetry: str,
    resolution: float,
    tolerance: float | None,
    of: Certified | None,
    cache: bool,
) -> Modes:
    from femnl.pipeline import solve_modes, solve_modes_to

    if tolerance is None:
        if of is not None:
            raise ParameterError(
                f"--tolerance-of {of}: there is no tolerance to reach; give one with --tolerance"
            )
        return solve_modes(model, count, symmetry, resolution, cache)
    if resolution != 1.0:
        raise ParameterError(
            f"--resolution {resolution:g}: a tolerance sets the resolution; give one of the two"
        )
    return solve_modes_to(model, tolerance, count, symmetry, cache, of or "frequency")


def _record(modes: Modes, nonlinearity: Nonlinearity) -> dict[str, Any]:
    columns = zip(
        modes.label,
        modes.frequency,
        modes.ratio,
        modes.effective_mass,
        nonlinearity.k3,
        nonlinearity.alpha,
        strict=True,
    )
    names = ("label", "frequency", "ratio", "effective_mass", "k3", "alpha")
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
    import numpy as np

    model = modes.domain.model
    # Modes of a few kilohertz and less in Hz, where six decimals of MHz hold nothing
    divisor, unit = (1e6, "MHz") if modes.frequency[-1] >= SLOW else (1.0, "Hz")
    rows = [
        [
            str(k + 1),
            modes.label[k] or "–",
            f"{modes.frequency[k] / divisor:.6f}",
            f"{modes.ratio[k]:.6f}",
            f"{modes.effective_mass[k] * 1e12:.5g}",
            scientific(nonlinearity.alpha[k] * 1e-12, 5),
            scientific(nonlinearity.k3[k], 5),
            f"{modes.frequency_error[k] / modes.frequency[k]:.0e}",
            f"{modes.ratio_error[k] / modes.ratio[k]:.0e}",
            f"{modes.effective_mass_error[k] / modes.effective_mass[k]:.0e}",
            f"{nonlinearity.alpha_error[k] / nonlinearity.alpha[k]:.0e}",
            f"{nonlinearity.k3_error[k] / nonlinearity.k3[k]:.0e}",
        ]
        for k in range(len(modes.frequency))
    ]
    columns = [
        "mode",
        "label",
        f"f ({unit})",
        "f/f₁",
        "m_eff (ng)",
        "α (µm⁻²)",
        "k₃ (N/m³)",
        "±f",
        "±f/f₁",
        "±m_eff",
        "±α",
        "±k₃",
    ]
    title = (
        f"{model.name}, in-plane edge {nonlinearity.edge}, "
        f"{'with' if model.bending else 'without'} bending; "
    )
    title += "± are relative" if modes.coarse else "an even film in the place of the holes"
    if modes.coarse is None:
        columns = columns[:7]
        rows = [row[:7] for row in rows]
    console().print(table(title, columns, rows))
    if nonlinearity.tensor is not None:
        n = len(modes.frequency)
        cross = [
            [str(i + 1), *(scientific(3 * nonlinearity.tensor[i, i, j, j], 4) for j in range(n))]
            for i in range(n)
        ]
        for i in range(n):
            cross[i][i + 1] = scientific(nonlinearity.tensor[i, i, i, i], 4)
        console().print(
            table(
                "Cubic force on mode i per q_i q_j² (diagonal: q_i³), N/m³",
                ["i\\j", *map(str, np.arange(n) + 1)],
                cross,
            )
        )
