"""`femnl bands GEOMETRY`: frequencies of waves in the film's lattice of holes."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from femnl.cli._device import Bending, Geometry, Json, load_device, suffix_of
from femnl.cli._output import console, note, print_json, table
from femnl.io.results.atomic import need_room

if TYPE_CHECKING:
    from femnl.mechanics.bands import Lattice

FORMATS = (".png", ".pdf", ".svg")
Out = Annotated[
    Path | None, typer.Option(help="Picture to write: .png, .pdf or .svg.", show_default=False)
]


def command(
    geometry: Geometry,
    *,
    count: Annotated[int, typer.Option("--count", "-n", help="How many bands.", min=1)] = 6,
    steps: Annotated[
        int,
        typer.Option(
            help="Wave vectors along the first side of the path; the other sides as closely.", min=1
        ),
    ] = 12,
    resolution: Annotated[
        float, typer.Option(help="Factor on the number of elements per length.")
    ] = 1.0,
    bending: Bending = None,
    out: Out = None,
    as_json: Json = False,
) -> None:
    """Solve the bands of flexural waves in the lattice of holes, as if the film had no edge."""
    if out:
        suffix_of(out, FORMATS)
        need_room(out)
    import numpy as np

    from femnl.mechanics.bands import solve_bands
    from femnl.mechanics.bands.words import speeds

    bands = solve_bands(load_device(geometry, bending), count, steps=steps, resolution=resolution)
    if as_json:
        names = (
            "wave",
            "frequency",
            "frequency_error",
            "corners",
            "tension",
            "mass",
            "speed",
            "axes",
            "gaps",
        )
        lattice = {"kind": bands.lattice.kind, "pitch": bands.lattice.pitch}
        print_json(
            {
                "geometry": geometry,
                "lattice": lattice,
                **{name: getattr(bands, name) for name in names},
            }
        )
    else:
        rows = [
            [
                name,
                *(f"{f / 1e6:.6f}" for f in bands.frequency[k]),
                f"{np.max(bands.frequency_error[k] / np.max(bands.frequency[k])):.0e}",
            ]
            for name, k in bands.corners[:-1]
        ]
        title = (
            f"{geometry}: {_name(bands.lattice)}, long waves {speeds(bands, 2)}; f in MHz, ± "
            "of the row relative to its highest"
        )
        console().print(table(title, ["", *(f"band {k + 1}" for k in range(count)), "±"], rows))
        gaps = ", ".join(f"{low / 1e6:.6g} … {high / 1e6:.6g} MHz" for low, high in bands.gaps)
        console().print(
            f"complete gaps, around and inside {'–'.join(name for name, _ in bands.corners)}: "
            f"{gaps or 'none'}"
        )
    if out:
        from femnl.plot.bands import draw_bands

        draw_bands(bands, out)
        note(f"wrote {out}")


def _name(lattice: Lattice) -> str:
    return f"{lattice.kind} lattice of pitch {lattice.pitch * 1e6:.5g} µm"
