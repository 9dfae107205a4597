"""The results of a sweep as tables: NetCDF for programs, CSV for spreadsheets.

The same bytes in whatever order points were solved.
"""

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from pydantic_core import PydanticCustomError

from femnl.device.geometry.quantities import DENSITY, LENGTH, PRESSURE, to_si
from femnl.io.results.atomic import write_whole
from femnl.sweep.point import KEPT, Record
from femnl.sweep.spec import Sweep
from femnl.sweep.store import Store


def collect(sweep: Sweep, store: Store) -> xr.Dataset:
    """Return what the store knows of every point of the sweep, in SI units.

    In the order of the sweep file.

    Returns: along `point`, a coordinate for everything that varies and `error`, the reason of a
        failure or nothing; along `point` and `mode`, the kept results, their errors (infinite where
        unknown), and labels. NaN where a point failed.
    """
    points = list(sweep.points(store.seed))
    records = [store.records[point.key(sweep.settings)] for point in points]
    data: dict[str, Any] = {
        path: _coordinate(path, [point.varied[path] for point in points]) for path in sweep.paths
    }
    data["error"] = ("point", np.array([record.get("error", "") for record in records]))
    data["label"] = (
        ("point", "mode"),
        np.array([_row(record, "label", "", sweep.settings.modes) for record in records]),
    )
    for name in sweep.settings.keep:
        for column in (name, f"{name}_error"):
            rows = [_row(record, column, np.nan, sweep.settings.modes) for record in records]
            data[column] = (
                ("point", "mode"),
                np.array([[np.inf if x is None else x for x in row] for row in rows]),
                {"units": KEPT[name]},
            )
    attributes = {"geometry": sweep.name, "base": json.dumps(sweep.base, ensure_ascii=False)}
    return xr.Dataset(
        data, {"mode": np.arange(1, sweep.settings.modes + 1)}, attributes
    ).set_coords(sweep.paths)


def write_tables(path: Path, sweep: Sweep, store: Store) -> tuple[Path, Path]:
    """Write what `collect` returns beside the store, as .nc and as .csv with a row a point."""
    data = collect(sweep, store)
    netcdf = path.with_suffix(".nc")
    table = path.with_suffix(".csv")
    content = data.to_netcdf(engine="h5netcdf")
    write_whole(netcdf, lambda file: file.write_bytes(content))
    write_whole(table, lambda file: _write_csv(file, sweep, data))
    return netcdf, table


def _write_csv(path: Path, sweep: Sweep, data: xr.Dataset) -> None:
    columns: dict[str, Any] = {
        _head(str(name), data[name]): data[name].values for name in (*sweep.paths, "error")
    }
    for name in ("label", *(n for kept in sweep.settings.keep for n in (kept, f"{kept}_error"))):
        for k, mode in enumerate(data.mode.values):
            columns[_head(f"{name}_{mode}", data[name])] = data[name].values[:, k]
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(zip(*(column.tolist() for column in columns.values()), strict=True))


def _head(name: str, values: xr.DataArray) -> str:
    unit = values.attrs.get("units", "1")
    return name if unit == "1" else f"{name} ({unit})"


def _row(record: Record, name: str, blank: Any, modes: int) -> list[Any]:
    return list(record["results"][name]) if "results" in record else [blank] * modes


def _coordinate(path: str, written: list[Any]) -> tuple[str, Any, dict[str, str]]:
    """Values of one path in SI where they are numbers or quantities, else as text."""
    if all(isinstance(value, int | float) and not isinstance(value, bool) for value in written):
        return "point", np.array(written, dtype=float), {"units": "1"}
    for dimension in (LENGTH, PRESSURE, DENSITY):
        try:
            return (
                "point",
                np.array([to_si(value, dimension, "any") for value in written]),
                {"units": dimension.unit},
            )
        except PydanticCustomError:
            continue  # of another dimension, or no quantity
    return (
        "point",
        np.array([value if isinstance(value, str) else json.dumps(value) for value in written]),
        {"long_name": path},
    )
