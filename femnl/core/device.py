"""The device as SI numbers.

Outline, holes, film, readout gap and the choices of the mechanical model.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields
from typing import Literal

import numpy as np

from femnl.core.choices import Edge as Edge
from femnl.core.errors import GeometryError
from femnl.core.geometry_text import film_values, same, with_values
from femnl.core.loss import Loss
from femnl.core.outline import Holes, Outline

FITS = 1.3
"""Factor up to which a stated length may differ from the box of the edge: a pentagon is quoted by
the diameter of the circle around it.
"""


@dataclass(frozen=True)
class Film:
    """The film.

    thickness [m], Young's modulus [Pa], Poisson's ratio, density [kg/m³], film stress before
    release [Pa].

    taper [m] and taper_length [m] describe a bottom thinned by the release etch: at distance d from
    the nearest hole's rim the thickness is less by taper·max(0, 1 − d/taper_length). gradient:
    (∂h/∂x, ∂h/∂y) of the deposited film, whose thickness is `thickness` at the origin. With neither
    the film is even.
    """

    thickness: float
    young: float
    poisson: float
    density: float
    stress: float
    taper: float = 0.0
    taper_length: float = 0.0
    gradient: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True)
class Clamp:
    """Springs along the edge that hold the film; infinite ones hold it rigidly.

    A force per length of edge and displacement [Pa]: deflection out of plane, normal and shear in
    plane, across and along the edge.
    rotation: a moment per length of edge and angle [N]; 0 is a hinge. draw [m]: how far inwards of
    the film's edge as deposited the normal springs are at rest, as a frame draws the edge with it
    that relaxes on release.
    """

    deflection: float = np.inf
    rotation: float = np.inf
    normal: float = np.inf
    shear: float = np.inf
    draw: float = 0.0

    @property
    def rigid(self) -> bool:
        """Whether nothing gives way."""
        return self == Clamp()

    @property
    def rigid_in_plane(self) -> bool:
        """Whether nothing gives way in the plane of the film."""
        return self.normal == self.shear == np.inf


@dataclass(frozen=True)
class Overhang:
    """An undercut strip of the frame around the suspended film.

    Its width [m], its outer rim, where it is clamped, and its film.
    """

    width: float
    outline: Outline
    film: Film


@dataclass(frozen=True)
class Lamina:
    """A further layer on the film, such as an electrode.

    thickness [m], Young's modulus [Pa], Poisson's ratio, density [kg/m³], stress [Pa] before
    release, tension positive. side: `top`, away from the substrate, towards which deflections
    count, or `bottom`.
    rims: closed curves; the layer is where an odd number of them goes around. None: everywhere.
    quality: quality factor of its material as it bends, one over its loss factor; None where it is
    not known.
    """

    name: str
    thickness: float
    young: float
    poisson: float
    density: float
    stress: float
    side: Literal["top", "bottom"]
    rims: tuple[Outline, ...] = ()
    quality: float | None = None


@dataclass(frozen=True)
class Layer:
    """One layer of the optical stack.

    thickness [m] (inf for the outer media) and complex index n − ik by wavelength [m].
    """

    material: str
    thickness: float
    index: tuple[tuple[float, complex], ...]


@dataclass(frozen=True)
class Stack:
    """The optical stack seen from the laser: outer medium, film, gap, wafer.

    The gap is the one layer that motion changes.
    """

    layers: tuple[Layer, ...]
    gap: int


@dataclass(frozen=True)
class Model:
    """A device and how it is modelled, in SI units.

    bending: whether the plate term D = Eh³/12(1−ν²) is kept. edge: in-plane condition of the
    outline for the
    nonlinearity: `clamped` u = v = 0; `sliding` normal displacement held and shear free; `paper` u
    = v = 0 with ν = 0 in the membrane strain, which is what the published closed formula of α
    assumes.
    clamp: what the edge gives way; overhang: an undercut strip of the frame around the outline, if
    there is one, whose outer rim is that edge.
    openings: inner edges of the film that `holes` does not list, each one closed loop, walked
    counter-clockwise like an outline: ellipses, holes of other radii, and posts, whose rims are
    clamped.
    loss: what the film's material loses.
    layers: what lies on the film, on either side in the order from the film outwards.
    grid [m]: the step to which a drawing rounds its coordinates, within which it is its own mirror
    image; 0 where the numbers are exact.
    text: the TOML text that this model was read from; results carry `described`. assumed: keys of
    that text, such as "holes.radius", whose values the source does not give. reader: makes a model
    of such a text.
    """

    name: str
    source: str
    outline: Outline
    holes: Holes
    film: Film
    stack: Stack | None
    bending: bool = True
    edge: Edge = "clamped"
    text: str = ""
    assumed: tuple[str, ...] = ()
    clamp: Clamp = Clamp()
    overhang: Overhang | None = None
    openings: tuple[Outline, ...] = ()
    loss: Loss = field(default_factory=Loss)
    grid: float = 0.0
    layers: tuple[Lamina, ...] = ()
    reader: Callable[[str], Model] | None = field(default=None, compare=False, repr=False)

    def refuse_contradictions(self) -> None:
        """Refuse a device whose outline states another length than its edge has.

        Raises: GeometryError.
        """
        least, most = self.outline.extent
        if not least / FITS <= self.outline.length <= most * FITS:
            raise GeometryError(
                f"{self.name}: its outline states a length of {self.outline.length * 1e6:.5g} µm, "
                f"but its edge spans {least * 1e6:.5g} µm; change the geometry by "
                "model.with_('outline.…', …)"
            )

    def with_(self, key: str, value: object) -> Model:
        """Return the device whose geometry file has another value.

        Args:
            key: of the file, dotted, as "film.stress" or "holes.radius"; groups of holes, points
                and layers are counted from 1.
            value: as the file would have it, "500 MPa".

        Raises:
            GeometryError: a key or value that the file cannot have, and a device that was changed
                by `dataclasses.replace`, whose text no longer describes it.
        """
        if self.reader is None:
            raise GeometryError(f"{self.name}: was not read from a geometry file; load one")
        if not self._is(self.text):
            raise GeometryError(
                f"{self.name}: was changed in Python, and its text no longer describes it; load it "
                "anew, and make every change by with_"
            )
        return self.reader(with_values(self.text, {key: value}, self.name))

    @property
    def described(self) -> str:
        """The text of a geometry file that describes the device, "" where none is known.

        The one that it was read from, where it still does; with the film's numbers and the choices
        of the mechanical model put right, where only these were changed by `dataclasses.replace`.
        """
        if not self.text or self._is(self.text):
            return self.text
        film = film_values(self.film)
        choices = {"model.bending": self.bending, "model.edge": self.edge}
        text = with_values(self.text, {**film, **choices}, self.name)
        return text if self._is(text) else ""

    def _is(self, text: str) -> bool:
        """Whether a text describes the device."""
        if self.reader is None:
            return False
        try:
            told = self.reader(text)
        except GeometryError:
            return False
        return all(
            same(getattr(self, one.name), getattr(told, one.name))
            for one in fields(self)
            if one.name not in ("text", "assumed", "reader")
        )

    @property
    def pierced(self) -> bool:
        """Whether the film has inner edges: holes, or openings of any kind."""
        return len(self.holes.centres) > 0 or len(self.openings) > 0

    @property
    def released(self) -> bool:
        """Whether the film ends free at an inner edge, towards which its stress relaxes."""
        return len(self.holes.centres) > 0 or any(
            not segment.clamped for opening in self.openings for segment in opening.segments
        )

    @property
    def etched_from(self) -> tuple[Holes, ...]:
        """The round holes with free rims, through which an etch comes, by radius."""
        found = [self.holes] if len(self.holes.centres) else []
        centres: dict[float, list[tuple[float, float]]] = {}
        for opening in self.openings:
            first = opening.segments[0]
            if opening.kind == "circle" and first.centre is not None and not first.clamped:
                centres.setdefault(opening.length / 2, []).append(first.centre)
        return (*found, *(Holes(np.array(c), radius) for radius, c in centres.items()))

    @property
    def edge_outline(self) -> Outline:
        """Where film and frame end: the outline, or the outer rim of the overhang."""
        return self.outline if self.overhang is None else self.overhang.outline

    def __repr__(self) -> str:
        """Name, outline, number of holes and film."""
        film = self.film
        n = len(self.holes.centres) + len(self.openings)
        size = (
            f"{self.outline.kind} of {self.outline.length * 1e6:.5g} µm, {n or 'no'} "
            f"hole{'s' * (n != 1)}"
        )
        return (
            f"<Model {self.name}: {size}, film {film.thickness * 1e9:.5g} nm at "
            f"{film.stress * 1e-6:.5g} MPa>"
        )
