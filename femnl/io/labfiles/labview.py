"""Measurement files of LabVIEW as text (.lvm): one segment of columns behind a head.

Columns have the headings of the file, X_Value first; Separator and Decimal_Separator are as the
head says. Comments behind the last column are left out.
Source: NI, "Specification for the LabVIEW Measurement File (.lvm)".
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from femnl.core.errors import MeasurementError
from femnl.io.labfiles.base import Format, Groups, head, text_lines
from femnl.io.labfiles.columns import one_table
from femnl.io.labfiles.spec import Spec

START = b"LabVIEW Measurement"
END = "***End_of_Header***"
SEPARATORS = {"Tab": "\t", "Comma": ",", "Semicolon": ";"}


def _read(paths: Sequence[Path], spec: Spec) -> tuple[Groups, list[str]]:
    return one_table(paths, spec, ".lvm file", _table)


def _table(path: Path) -> dict[str, NDArray[Any]]:
    """Return the columns by heading. Raises: MeasurementError naming the line that is wrong."""
    lines = text_lines(path)
    ends = [k for k, line in enumerate(lines) if line.strip().startswith(END)]
    if not ends:
        raise MeasurementError(f"{path}: no line {END}; export it again")
    # One head for the file, and one for each segment of data
    if len(ends) > 2:
        raise MeasurementError(
            f"{path}: has {len(ends) - 1} segments of data; save each in a file of its own"
        )
    settings = dict(
        line.strip().split(None, 1) for line in lines[: ends[0]] if len(line.split(None, 1)) == 2
    )
    mark = SEPARATORS.get(settings.get("Separator", "Tab").strip(), "\t")
    comma = settings.get("Decimal_Separator", ".").strip() == ","
    body = [(k, line) for k, line in enumerate(lines) if k > ends[-1] and line.strip()]
    if len(body) < 2:
        raise MeasurementError(f"{path}: no data behind {END}; export it again")
    names = [cell.strip() for cell in body[0][1].split(mark)]
    if names and names[-1] in ("Comment", ""):
        names = names[:-1]
    if len(set(names)) < len(names):
        raise MeasurementError(f"{path}: line {body[0][0] + 1}: a heading stands twice; rename one")
    rows = [_row(path, k, line, mark, comma, len(names)) for k, line in body[1:]]
    columns = np.array(rows).T
    found = dict(zip(names, columns, strict=True))
    # Without X columns, X_Value stands empty
    return {name: column for name, column in found.items() if not np.isnan(column).all()}


def _row(path: Path, k: int, line: str, mark: str, comma: bool, count: int) -> list[float]:
    """Return the numbers of a line, NaN where a cell is empty."""
    cells = line.split(mark)
    if len(cells) < count:
        raise MeasurementError(
            f"{path}: line {k + 1}: {len(cells)} cells for {count} columns; correct it"
        )
    found = []
    for cell in cells[:count]:
        text = cell.strip().replace(",", ".") if comma else cell.strip()
        try:
            found.append(float(text) if text else float("nan"))
        except ValueError:
            raise MeasurementError(
                f"{path}: line {k + 1}: {text[:30]!r} is not a number; correct it"
            ) from None
    return found


FORMAT = Format("LabVIEW text", lambda path: head(path).startswith(START), _read, priority=1)
