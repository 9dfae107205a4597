"""Solved modes as NetCDF: all that shapes and nonlinearity need again, in SI units."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np
from skfem import MeshTri2

from femnl.core.device import Model
from femnl.core.domain import Domain, Prestress
from femnl.core.modes import Modes
from femnl.core.nonlinearity import Nonlinearity
from femnl.io.results.atomic import write_whole

if TYPE_CHECKING:
    # At run time where it is needed: to load it takes as long as to solve a film of condensed cells
    import xarray as xr

VERSION = "1.3"
PARTS = ("overhang", "layer-")  # names of the parts of a mesh that are not of the film alone
GRADES = ("coarse", "coarser")  # groups of the counterparts of lower degree


def write_modes(path: Path, modes: Modes, nonlinearity: Nonlinearity | None = None) -> None:
    """Write modes, and their nonlinearity where given, to one NetCDF-4 file.

    Units are attributes of the datasets.

    Groups: `/modes`, `/mesh` points, triangles and boundaries, `/coarse` the same modes at one
    degree less, `/coarser` at two.
    """
    import xarray as xr

    tree = xr.DataTree.from_dict(
        {"/modes": _modes_dataset(modes, nonlinearity), "/mesh": _mesh_dataset(modes.domain.mesh)}
    )
    for name, lower in zip(GRADES, modes.grades[1:], strict=False):
        tree[name] = xr.DataTree(_modes_dataset(lower, None))
    model = modes.domain.model
    tree.attrs = {
        "femnl_modes": VERSION,
        "geometry": model.name,
        "model": model.described,
        "edge": model.edge,
        "bending": int(model.bending),
        "wedge": modes.domain.wedge,
        "tiles": modes.domain.tiles,
        "misfit": modes.domain.misfit,
        "middle": modes.domain.middle,
    }
    # Made in memory: HDF5 that meets a full disk fails a second time when it closes its file, and
    # says so on standard error.
    content = tree.to_netcdf(engine="h5netcdf")
    write_whole(path, lambda file: file.write_bytes(content))


def read_modes(path: Path, model: Model) -> Modes:
    """Read modes of the given model back.

    Raises: OSError, KeyError or ValueError for a file that `write_modes` did not write.
    """
    # Without xarray: to load it takes as long as all else of a command whose modes are kept
    with h5py.File(path) as file:
        version = _attribute(file, "femnl_modes")
        if version != VERSION:
            raise ValueError(f"{path}: version {version} where {VERSION} is read")
        stored = {name: values[...] for name, values in file["mesh"].items()}
        mesh = MeshTri2(
            np.ascontiguousarray(stored["points"]),
            np.ascontiguousarray(stored["triangles"]),
            _boundaries={
                name.removeprefix("boundary_"): values
                for name, values in stored.items()
                if name.startswith("boundary_")
            },
            _subdomains={name: values for name, values in stored.items() if name.startswith(PARTS)}
            or None,
        )
        wedge, tiles = (float(_attribute(file, name)) for name in ("wedge", "tiles"))
        # Older files have no ellipses
        misfit = float(_attribute(file, "misfit")) if "misfit" in file.attrs else 0.0
        # Older files lie about the origin, or hold whole films
        x, y = map(float, file.attrs.get("middle", (0.0, 0.0)))
        domain = Domain(model, mesh, wedge, tiles=tiles, misfit=misfit, middle=(x, y))
        found: Modes | None = None
        for name in reversed(("modes", *GRADES)):
            if name in file:
                found = replace(_modes(file[name], domain), coarse=found)
    if found is None:
        raise KeyError(f"{path}: holds no group modes")
    return found


def _mesh_dataset(mesh: MeshTri2) -> "xr.Dataset":
    import xarray as xr

    data: dict[str, Any] = {
        "points": (("axis", "node"), mesh.doflocs, {"units": "m"}),
        "triangles": (("corner", "triangle"), mesh.t),
    }
    for name, facets in (mesh.boundaries or {}).items():
        data[f"boundary_{name}"] = ((f"facet_{name}",), np.asarray(facets, dtype=np.int64))
    for name, members in (mesh.subdomains or {}).items():
        data[name] = ((f"triangle_{name}",), np.asarray(members, dtype=np.int64))
    return xr.Dataset(data)


def _modes_dataset(modes: Modes, nonlinearity: Nonlinearity | None) -> "xr.Dataset":
    import xarray as xr

    data: dict[str, Any] = {
        "frequency": ("mode", modes.frequency, {"units": "Hz"}),
        "frequency_error": ("mode", modes.frequency_error, {"units": "Hz"}),
        "effective_mass": ("mode", modes.effective_mass, {"units": "kg"}),
        "label": ("mode", np.array([label or "" for label in modes.label])),
        "parity": (
            ("mode", "mirror"),
            np.array(modes.parity, dtype=np.int64).reshape(len(modes.frequency), -1),
        ),
        "shapes": (("mode", "unknown"), modes.shapes),
        "displacement": (("in_plane_unknown",), modes.prestress.displacement, {"units": "m"}),
    }
    if modes.coarse is not None:
        data["frequency_error"] = ("mode", modes.frequency_error, {"units": "Hz"})
        data["effective_mass_error"] = ("mode", modes.effective_mass_error, {"units": "kg"})
    if modes.departure is not None:
        data["departure"] = ("mode", modes.departure)
    if modes.coupling is not None:
        data["coupling"] = (("mode", "mode_j"), modes.coupling, {"units": "Hz"})
    if nonlinearity is not None:
        data["k3"] = ("mode", nonlinearity.k3, {"units": "N/m^3", "edge": nonlinearity.edge})
        data["alpha"] = ("mode", nonlinearity.alpha, {"units": "m^-2", "edge": nonlinearity.edge})
        data["k3_error"] = ("mode", nonlinearity.k3_error, {"units": "N/m^3"})
        data["alpha_error"] = ("mode", nonlinearity.alpha_error, {"units": "m^-2"})
        if nonlinearity.tensor is not None:
            data["tensor"] = (
                ("mode", "mode_j", "mode_k", "mode_l"),
                nonlinearity.tensor,
                {"units": "N/m^3"},
            )
        if nonlinearity.tensor_error is not None:
            data["tensor_error"] = (
                ("mode", "mode_j", "mode_k", "mode_l"),
                nonlinearity.tensor_error,
                {"units": "N/m^3"},
            )
    return xr.Dataset(
        data,
        attrs={
            "degree": modes.degree,
            "prestress_degree": modes.prestress.degree,
            "first": modes.first,
        },
    )


def _attribute(group: h5py.Group, name: str) -> Any:
    """Return one value: a number is stored as an array of one."""
    value = group.attrs[name]
    return value.item() if isinstance(value, np.ndarray) else value


def _modes(data: h5py.Group, domain: Domain) -> Modes:
    degree = int(_attribute(data, "prestress_degree"))
    prestress = Prestress(domain, degree, data["displacement"][...])
    parity = tuple(tuple(int(s) for s in row) for row in data["parity"][...])
    label = tuple(str(text) or None for text in data["label"].asstr()[...])
    departure, coupling = (
        data[name][...] if name in data else None for name in ("departure", "coupling")
    )
    return Modes(
        prestress,
        int(_attribute(data, "degree")),
        data["frequency"][...],
        data["effective_mass"][...],
        data["shapes"][...],
        parity,
        label,
        departure=departure,
        coupling=coupling,
        # Older files hold the lowest modes
        first=int(_attribute(data, "first")) if "first" in data.attrs else 1,
    )
