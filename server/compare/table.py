"""A table of numbers, the same for the terminal and for HTML: columns with units, cells that may be unknown."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from rich import box
from rich.table import Table as RichTable

Cell = str | float | None
UNKNOWN: Final = "–"


@dataclass(frozen=True, slots=True, kw_only=True)
class Column:
    """One column.

    Attributes:
        name: heading; the unit stands below it.
        unit: as shown to people, "" for none.
        digits: after the decimal point.
        meaning: one sentence for whoever points at the heading.
        right: set right even where its cells are texts.
    """

    name: str
    unit: str = ""
    digits: int = 2
    meaning: str = ""
    right: bool = False

    def text(self, cell: Cell) -> str:
        """Return a cell as it is shown; what is unknown is a dash, never a zero."""
        if isinstance(cell, str):
            return cell
        if cell is None or not math.isfinite(cell):
            return UNKNOWN
        return f"{cell:z,.{self.digits}f}"


def columns_of(columns: Sequence[Column | str]) -> tuple[Column, ...]:
    """Return columns; a plain name is a column without a unit."""
    return tuple(Column(name=each) if isinstance(each, str) else each for each in columns)


def is_right(column: Column, cells: Sequence[Cell]) -> bool:
    """Return whether a column is aligned right, as numbers are."""
    return column.right or not any(isinstance(cell, str) for cell in cells)


def terminal(title: str, columns: Sequence[Column | str], rows: Sequence[Sequence[Cell]]) -> RichTable:
    """Return the table for a terminal."""
    chosen = columns_of(columns)
    out = RichTable(title=title, title_justify="left", title_style="bold", box=box.SIMPLE_HEAD, pad_edge=False)
    for place, column in enumerate(chosen):
        number = is_right(column, [row[place] for row in rows])
        heading = f"{column.name}\n{column.unit}" if column.unit else column.name
        out.add_column(heading, justify="right" if number else "left", no_wrap=place == 0)
    for row in rows:
        out.add_row(*(column.text(cell) for column, cell in zip(chosen, row, strict=True)))
    return out
