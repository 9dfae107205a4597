"""The tables of a geometry file, and the model that they make."""

import re
from collections.abc import Callable
from functools import partial
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Field, PlainValidator, model_validator
from pydantic_core import PydanticCustomError

from femnl.core.device import Edge, Layer, Model, Stack
from femnl.core.errors import GeometryError
from femnl.core.outline import Holes
from femnl.device.geometry.edges import ClampTable, FilmTable, OverhangTable
from femnl.device.geometry.hole_faults import refuse_outside, refuse_overlap
from femnl.device.geometry.holes import HoleGroups
from femnl.device.geometry.layers import Laminae, laminae
from femnl.device.geometry.loss import LossTable
from femnl.device.geometry.naming import plain_name
from femnl.device.geometry.openings import Openings, joined, openings, refuse_misplaced
from femnl.device.geometry.outlines import OutlineTable
from femnl.device.geometry.quantities import LENGTH, Depth, Length, refusal, to_si
from femnl.device.geometry.tables import Table, show
from femnl.device.geometry.validity import refuse_fine, refuse_thick
from femnl.device.geometry.webs import Web

Thickness = float | Literal["film", "gap"] | None
Indices = tuple[tuple[float, complex], ...]
LayerRow = tuple[str, Thickness, Indices]

RED = 632.8e-9
GREEN = 532e-9
PAPER_STACK: tuple[LayerRow, ...] = (
    ("vacuum", None, ((RED, 1 + 0j), (GREEN, 1 + 0j))),
    ("SiN", "film", ((RED, 2.0395 + 0j), (GREEN, 2.0559 + 0j))),
    ("vacuum", "gap", ((RED, 1 + 0j), (GREEN, 1 + 0j))),
    ("Si", None, ((RED, 3.8640 - 0.0158j), (GREEN, 4.1366 - 0.0338j))),
)
"""Material, thickness, and index n − ik by wavelength [m], from the laser down. Source: Sommer et
al. 2025, supplement S6, table of reflectivity values; SiN from Luke et al. 2015 (the paper cites
Philipp 1973, who gives 2.0105 and 2.0269), Si from Schinke et al. 2015."""

_COMPLEX = re.compile(
    r"\s*(\d{1,4}(?:\.\d{1,12})?)\s*-\s*(\d{1,4}(?:\.\d{1,12})?)\s*i\s*", re.ASCII
)


def _indices(value: Any) -> Indices:
    """Return index by wavelength from a table.

    Such as {"632.8 nm" = 2.0395, "532 nm" = "4.1366 - 0.0338i"}.
    """
    if not isinstance(value, dict) or not value:
        raise refusal('expected indices by wavelength, write e.g. index = {"632.8 nm" = 2.0395}')
    table = {_wavelength(wavelength): _index(index) for wavelength, index in value.items()}
    if len(table) < len(value):
        raise refusal("two of these wavelengths are the same")
    return tuple(table.items())


def _wavelength(key: str) -> float:
    try:
        return to_si(key, LENGTH)
    except PydanticCustomError as error:
        raise refusal(f"wavelength {show(key)}: {error}") from None


def _index(value: Any) -> complex:
    if isinstance(value, float | int) and not isinstance(value, bool) and 0 < value < 100:
        return complex(value)
    if isinstance(value, str) and (match := _COMPLEX.fullmatch(value)) and float(match[1]) > 0:
        return complex(float(match[1]), -float(match[2]))
    raise refusal(
        f"{show(value)} is no refractive index n − ik, write e.g. 2.0395 or, where light is "
        'absorbed, "3.8640 - '
        '0.0158i"'
    )


def _layer_thickness(value: Any) -> float | str:
    return value if value in ("film", "gap") else to_si(value, LENGTH)


class LayerTable(Table):
    """One layer of the stack.

    A thickness "film" or "gap" is the one given elsewhere; the outer media have none.
    """

    material: str
    thickness: Annotated[Thickness, BeforeValidator(_layer_thickness)] = None
    index: Annotated[Indices, PlainValidator(_indices)]


class ReadoutTable(Table):
    """The optical stack from the laser down: `layers`, or that of the source paper."""

    gap: Length
    layers: list[LayerTable] | None = None

    @model_validator(mode="after")
    def _is_a_stack(self) -> Self:
        if self.layers is None:
            return self
        thicknesses = [layer.thickness for layer in self.layers]
        if (
            len(thicknesses) < 3
            or thicknesses[0] is not None
            or thicknesses[-1] is not None
            or None in thicknesses[1:-1]
        ):
            raise refusal(
                "expected at least three layers, all with a thickness but the outer media, the "
                "first and the last"
            )
        if thicknesses.count("gap") != 1 or thicknesses.count("film") > 1:
            raise refusal('expected one layer with thickness = "gap", and at most one with "film"')
        wavelengths = [{w for w, _ in layer.index} for layer in self.layers]
        if any(w != wavelengths[0] for w in wavelengths):
            raise refusal("expected the index of every layer at the same wavelengths")
        return self

    def stack(self, film: FilmTable) -> Stack:
        """Return the stack with the film and the gap put in."""
        rows = (
            PAPER_STACK
            if self.layers is None
            else [(layer.material, layer.thickness, layer.index) for layer in self.layers]
        )
        known = {"film": film.thickness, "gap": self.gap, None: np.inf}
        layers = tuple(
            Layer(material, size if isinstance(size, float) else known[size], index)
            for material, size, index in rows
        )
        return Stack(layers, [thickness for _, thickness, _ in rows].index("gap"))


class ModelTable(Table):
    """How the device is modelled; see types.device.Model."""

    bending: bool = True
    edge: Edge = "clamped"


class GeometryFile(Table):
    """A whole geometry file.

    `assumed` names the values, such as "film.young", that the source does not give. `grid` is the
    step to which a drawing rounds its coordinates.
    """

    name: Annotated[str, AfterValidator(plain_name)]
    source: str = ""
    grid: Depth = 0.0
    assumed: list[str] = Field(default_factory=list)
    outline: OutlineTable
    holes: HoleGroups | None = None
    film: FilmTable
    layers: Laminae = Field(default_factory=list)
    readout: ReadoutTable | None = None
    loss: LossTable = LossTable()
    clamp: ClampTable = ClampTable()
    overhang: OverhangTable | None = None
    model: ModelTable = ModelTable()

    def inner(self) -> tuple[Holes, Openings]:
        """Return the lattice of like holes, and all other inner edges."""
        groups = self.holes or []
        lattice = next((group for group in groups if group.alike), None)
        holes = Holes(np.empty((0, 2)), 0.0)
        if lattice is not None and isinstance(lattice.radius, float):
            holes = Holes(lattice.positions(), lattice.radius)
        others = openings([group for group in groups if group is not lattice])
        if isinstance(self.outline, Web):
            others = joined(others, self.outline.windows())
        return holes, others

    def faults(self, holes: Holes, inner: Openings) -> list[GeometryError]:
        """Return what is wrong with where the holes are, the first of each kind.

        Args: holes, inner: what `inner` returns.

        Raises:
            GeometryError: an outline that cannot be made.
        """
        found = _refusals([partial(refuse_overlap, holes)])
        if found and self.outline.kind == "etched":  # which follows the holes
            return found
        outline = self.outline.outline(holes)
        checks: list[Callable[[], None]] = [partial(refuse_misplaced, inner, holes, outline)]
        if outline.kind != "etched":  # the etch reaches further than the hole that it starts from
            checks.append(partial(refuse_outside, holes, outline))
        return found + _refusals(checks)

    def build(self, text: str) -> Model:
        """Return the device in SI units.

        Raises:
            GeometryError: holes or an outline that cannot be made, in one line without the file's
            name.
        """
        holes, inner = self.inner()
        others = inner.rims
        if others and self.outline.kind == "etched":
            raise GeometryError(
                '[holes] kind = "etched" takes one group of round, free holes of one radius; '
                "leave the others out or choose another kind of outline"
            )
        for fault in self.faults(holes, inner):
            raise fault
        outline = self.outline.outline(holes)
        free = [o for o in others if not o.segments[0].clamped]
        if self.film.taper > 0 and any(o.kind != "circle" for o in free):
            raise GeometryError(
                f"[film] taper = {self.film.taper * 1e9:.4g} nm: it is known around round holes "
                "only; leave taper out, or give the holes a radius instead of semi_axes"
            )
        if self.film.taper > 0 and not len(holes.centres) and not free:
            raise GeometryError(
                f"[film] taper = {self.film.taper * 1e9:.4g} nm: there are no holes to thin the "
                "film around; write a table [holes]"
            )
        film = self.film.film(outline)
        refuse_thick(outline, film)
        overhang = (
            self.overhang.overhang(self.outline, holes, self.film)
            if self.overhang is not None
            else None
        )
        refuse_fine(outline, holes, others, overhang)
        if self.overhang is not None and self.layers:
            raise GeometryError(
                "[layers] and [overhang] are not modelled together; leave one of them out"
            )
        clamp = self.clamp.clamp()
        if self.model.edge != "clamped" and not clamp.rigid_in_plane:
            raise GeometryError(
                f'[model] edge = "{self.model.edge}": [clamp] says how the edge gives way in '
                "plane; leave one out"
            )
        return Model(
            self.name,
            self.source,
            outline,
            holes,
            film,
            self.readout.stack(self.film) if self.readout is not None else None,
            self.model.bending,
            self.model.edge,
            text,
            tuple(self.assumed),
            clamp,
            overhang,
            others,
            self.loss.loss(),
            self.grid,
            laminae(self.layers, outline),
        )


def _refusals(checks: list[Callable[[], None]]) -> list[GeometryError]:
    found = []
    for check in checks:
        try:
            check()
        except GeometryError as error:
            found.append(error)
    return found
