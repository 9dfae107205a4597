"""Results as tables: aligned text for `print`, HTML for notebooks, columns with SI units."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

Columns = Mapping[str, tuple[ArrayLike, str]]
"""Values (n,) and their SI unit, "1" for plain numbers and "" for text, by name."""

_STYLE = """<style>
.femnl th, .femnl td { text-align: right; padding: 0.1em 0.6em }
.femnl th:first-child { text-align: left }
</style>"""


@dataclass(frozen=True)
class Table:
    """A heading, columns of texts by their names, and sentences below."""

    title: str
    columns: Mapping[str, Sequence[str]]
    notes: Sequence[str] = ()

    def text(self) -> str:
        """Return aligned plain text."""
        frame = self._frame()
        # Two spaces part the names of columns, as they part numbers
        widths = [len(name) + 1 for name in frame.columns]
        body = [] if frame.empty else [frame.to_string(col_space=widths)]
        return "\n".join([self.title, *body, *(f"  {note}" for note in self.notes)])

    def html(self) -> str:
        """Return HTML that needs no other file, its text escaped."""
        title = f"<p><strong>{escape(self.title)}</strong></p>"
        frame = self._frame()
        body = [] if frame.empty else [frame.to_html(border=0, classes="femnl")]
        notes = "<br/>\n".join(escape(note) for note in self.notes)
        return "\n".join(["<div>", title, *body, f"<p>{notes}</p>", "</div>"])

    def _frame(self) -> "pd.DataFrame":
        import pandas as pd

        # The first column names the rows, and its own name stands in the line of the others
        first = next(iter(self.columns))
        return pd.DataFrame(self.columns).set_index(first).rename_axis(index=None, columns=first)


class Tabulated(ABC):
    """A result that `print` and notebooks show as tables instead of arrays."""

    @abstractmethod
    def _tables(self) -> Sequence[Table]:
        """Return what is shown, in its order."""

    def summary(self) -> str:
        """Return a plain-text table: values with errors, and units."""
        return "\n\n".join(table.text() for table in self._tables())

    def __str__(self) -> str:
        """Return the summary."""
        return self.summary()

    def _repr_html_(self) -> str:
        return "\n".join([_STYLE, *(table.html() for table in self._tables())])


def dataset(dim: str, coordinates: Columns, values: Columns) -> "xr.Dataset":
    """Return columns along one dimension, with their units as attributes."""
    import xarray as xr

    return xr.Dataset(_variables(dim, values), _variables(dim, coordinates))


def dataframe(found: "xr.Dataset") -> "pd.DataFrame":
    """Return a row for each point of a dataset; `attrs["units"]` holds the units by column."""
    frame = found.to_dataframe()
    frame.attrs = {"units": {name: found[name].attrs.get("units", "") for name in frame.columns}}
    return frame


def _variables(dim: str, columns: Columns) -> dict[str, tuple[str, ArrayLike, dict[str, str]]]:
    return {
        name: (dim, values, {"units": unit} if unit else {})
        for name, (values, unit) in columns.items()
    }
