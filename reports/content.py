"""What a report is made of: tables, drawings and what is said beside them, one section after another."""

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Table:
    """Rows of text below their columns' names. The first column is words; the others are numbers, or `words` too.

    `note` says beside the table what its numbers are.
    """

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    note: str = ""
    words: bool = False


@dataclass(frozen=True)
class Section:
    """A part of a report: its heading, sentences, then a table, then drawings as SVG (`reports.drawing`)."""

    heading: str
    sentences: Sequence[str] = ()
    table: Table | None = None
    drawings: Sequence[str] = ()
