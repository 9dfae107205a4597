"""From devices and validation cases to one page."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from femnl.core import resources
from femnl.core.numbers import plain, with_error
from femnl.device.geometry.reader import load
from femnl.io.results.atomic import make_folder, write_text_whole
from femnl.plot.screen import need_offscreen
from femnl.report.benchmarks import Benchmark, benchmarks
from femnl.report.blind import Blind, blind
from femnl.report.checks import Checks, check
from femnl.report.inplane import in_plane_figure
from femnl.report.mechanics import (
    EDGES,
    Geometry,
    Part,
    Row,
    alpha_table,
    describe_geometry,
    frequency_table,
    ratio_table,
    solve,
    summary_of,
)
from femnl.report.picture import Picture, embed
from femnl.report.provenance import provenance
from femnl.report.published import DEVICES, Device
from femnl.report.readout import Maps, Spectrum, maps, spectrum
from femnl.report.shape import turning
from femnl.report.template import template

NAME = "index.html"
IN_PLANE = (
    "The fundamental mode, deflected by 1 µm, stretches the film, which gives way in its own "
    "plane as far as its edge lets it: α is what stretching remains. Displacements go as the "
    "square of the deflection."
)


@dataclass(frozen=True)
class Section:
    """A device on the page."""

    device: Device
    parts: list[Part]
    names: list[str]
    head: list[str]
    frequencies: list[Row]
    ratios: tuple[Row, list[Row]] | None
    alphas: tuple[Row, list[Row]]
    in_plane: Picture
    maps: list[Maps]
    spectrum: Spectrum | None
    summary: list[tuple[str, str]]


def write_report(
    out: Path,
    progress: Callable[[str], None],
    cache: bool = True,
    devices: Sequence[Device] = DEVICES,
    cases: Path | None = None,
    select: Sequence[str] = (),
) -> Path:
    """Solve the devices, run the validation cases, and write `index.html` into a folder.

    The page needs no other file.

    Args: out: the folder, made where it is missing. progress: told, in a few words, what comes
        next. cache: take modes solved earlier from disk. devices: those to report on. cases: the
        folder of validation cases, the shipped one by default; select: names of cases, all where
        empty.
    Returns: the path of the page.
    Raises: MissingLibraryError before anything is solved where pictures cannot be drawn;
    ParameterError; whatever solving raises.
    """
    need_offscreen()
    make_folder(out)
    solved = [solve(device, progress, cache) for device in devices]
    sections = [
        _section(device, geometries, progress)
        for device, geometries in zip(devices, solved, strict=True)
    ]
    checks = check(cases or resources.cases(), select, progress)
    evidence = _Evidence(
        checks, blind(cases or resources.cases()), benchmarks(cases or resources.cases())
    )
    return _write(out, progress, solved, sections, evidence)


def write_device(
    geometry: str | Path, out: Path, progress: Callable[[str], None], cache: bool = True
) -> Path:
    """Solve one device, and write `index.html` on it into a folder.

    The page needs no other file, and says nothing of what femnl is checked against.

    Args: geometry: a shipped name, or the path of a TOML file. out, progress, cache: as
        `write_report`.
    Returns: the path of the page.
    Raises: GeometryError; MissingLibraryError before anything is solved where pictures cannot be
    drawn; ParameterError; whatever solving raises.
    """
    need_offscreen()
    model = load(geometry)
    make_folder(out)
    device = Device(model.name, (str(geometry),))
    solved = [solve(device, progress, cache)]
    return _write(out, progress, solved, [_section(device, solved[0], progress)], None)


@dataclass(frozen=True)
class _Evidence:
    """What femnl is checked against: validation cases, hidden causes, other programs."""

    checks: Checks
    blind: list[Blind]
    benchmarks: list[Benchmark]


def _write(
    out: Path,
    progress: Callable[[str], None],
    solved: list[list[Geometry]],
    sections: list[Section],
    evidence: _Evidence | None,
) -> Path:
    progress("page")
    models = [geometry.model for geometries in solved for geometry in geometries]
    page = template("page.html.j2").render(
        sections=sections,
        evidence=evidence,
        models=models,
        shape=turning(solved[0][0].modes) if solved else None,
        provenance=provenance(models),
        edges=EDGES,
        plain=plain,
        with_error=with_error,
    )
    path = out / NAME
    write_text_whole(path, page)
    return path


def _section(
    device: Device, geometries: list[Geometry], progress: Callable[[str], None]
) -> Section:
    first = geometries[0]
    published = device.published
    stack = first.model.stack
    drives = () if published is None else published.drives
    shown = [maps(first, stack, drive, progress) for drive in drives if stack is not None]
    return Section(
        device,
        [describe_geometry(geometry, progress) for geometry in geometries],
        [geometry.model.name for geometry in geometries],
        [word for geometry in geometries for word in (geometry.model.name, "− measured")],
        [] if published is None else frequency_table(geometries, published),
        None if published is None else ratio_table(geometries, published),
        alpha_table(geometries, published),
        embed(in_plane_figure(first.modes), f"In-plane response of {first.model.name}", IN_PLANE),
        shown,
        None
        if published is None or stack is None or not drives
        else spectrum(stack, drives[0], published),
        summary_of(first),
    )
