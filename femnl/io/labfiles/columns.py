"""Lab files that hold one table of columns: what all such formats do once their table is read."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from femnl.core.errors import MeasurementError
from femnl.io.labfiles.base import Groups
from femnl.io.labfiles.named_columns import take_columns, unread
from femnl.io.labfiles.spec import Spec
from femnl.io.labfiles.stated_units import as_stated, heading_unit
from femnl.io.labfiles.tables import to_dataset

Table = Mapping[str, NDArray[Any]]


def one_table(
    paths: Sequence[Path],
    spec: Spec,
    what: str,
    read: Callable[[Path], Table],
    units: Mapping[str, str] | None = None,
) -> tuple[Groups, list[str]]:
    """Return the measurement that a file of one table holds, and what was told of it.

    Args: paths: of which there may be one only; spec: says what the columns are; what: the file is
        called in messages; read: returns the columns of the file by heading or number; units: that
        stand beside them in the file, by column.
    Raises: MeasurementError for several files, and for columns that are no measurement.
    """
    if len(paths) > 1:
        raise MeasurementError(
            f"{paths[1]}: one {what} at a time; import each into a file of its own"
        )
    where = str(paths[0])
    table = read(paths[0])
    told: list[str] = []
    if spec.kind is not None:
        in_headings = {name: heading_unit(name) for name in table}
        by_number = {str(n): unit for n, unit in enumerate(in_headings.values(), 1)}
        in_headings = by_number | in_headings
        spec, told = as_stated(spec, in_headings | dict(units or {}), where)
    dataset, notes = to_dataset(spec, take_columns(spec, table, where), where)
    return {spec.name: dataset}, [*told, *notes, *unread(spec, table, where)]
