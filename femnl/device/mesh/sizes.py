"""Sizes of elements that grow with the distance from curves and points, as gmsh's fields."""

from dataclasses import dataclass
from typing import Any

import gmsh
import numpy as np
from numpy.typing import NDArray

from femnl.device.mesh.kernel import length
from femnl.device.mesh.openings import AN_ELEMENT

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Sizes:
    """gmsh's fields of sizes as they are collected, and what each adds to ∫ dA / h².

    Args:
        resolution: as of `mesh`.
        largest: size far from everything, in gmsh's lengths, as all others.
        kernel: gmsh's, which draws the film.
        fields: gmsh's tags of the fields so far.
        inverse_square: what each adds.
        lengths: of curves that gmsh need not be asked for.
    """

    resolution: float
    largest: float
    kernel: Any
    fields: list[int]
    inverse_square: list[float]
    lengths: dict[int, float]

    @property
    def grading(self) -> float:
        """By what sizes grow less steeply in finer meshes."""
        return max(self.resolution, 1.0)

    def grow(self, size: float, distance: int, growth: float) -> None:
        """Let elements grow from a size with the distance that a field of gmsh's holds."""
        if size >= self.largest:
            return
        field = gmsh.model.mesh.field
        self.fields.append(field.add("Threshold"))
        field.setNumber(self.fields[-1], "InField", distance)
        field.setNumber(self.fields[-1], "SizeMin", size)
        field.setNumber(self.fields[-1], "SizeMax", self.largest)
        field.setNumber(self.fields[-1], "DistMin", 0)
        reach = (self.largest - size) * self.grading / growth
        field.setNumber(self.fields[-1], "DistMax", reach)

    def grow_from_curves(
        self,
        size: float,
        tags: list[int],
        growth: float,
        fan: float = 1.0,
        points: list[int] | None = None,
    ) -> None:
        """Let elements grow from curves. fan: triangles over those along a straight line.

        points: of further curves, AN_ELEMENT an element.
        """
        field = gmsh.model.mesh.field
        distance = field.add("Distance")
        lengths = [self.lengths.get(t) or length(t, self.kernel) for t in tags]
        along = sum(lengths) / size + len(points or []) / AN_ELEMENT
        self.inverse_square.append(fan * along * self.grading / growth)
        field.setNumbers(distance, "CurvesList", tags)
        field.setNumbers(distance, "PointsList", points or [])
        # gmsh measures the distance to points along the curves: two an element hide the gaps
        # between them.
        field.setNumber(distance, "Sampling", np.ceil(2 * max(lengths, default=0.0) / size))
        self.grow(size, distance, growth)

    def grow_from_points(self, size: float, tags: list[int], growth: float) -> None:
        """Let elements grow from points."""
        distance = gmsh.model.mesh.field.add("Distance")
        gmsh.model.mesh.field.setNumbers(distance, "PointsList", tags)
        self.grow(size, distance, growth)

    def points(self, places: Array) -> list[int]:
        """Return gmsh's tags of points (n, 2) that bound nothing, from which sizes grow."""
        return [self.kernel.addPoint(x, y, 0) for x, y in places]

    def set(self) -> float:
        """Hand the smallest of all sizes to gmsh; return about how many triangles it makes."""
        self.kernel.synchronize()  # once, as it takes seconds with thousands of openings
        gmsh.option.setNumber("Mesh.MeshSizeMax", self.largest)
        if self.fields:
            field = gmsh.model.mesh.field
            smallest = field.add("Min")
            field.setNumbers(smallest, "FieldsList", self.fields)
            field.setAsBackgroundMesh(smallest)
        return float(4 / np.sqrt(3) * sum(self.inverse_square))
