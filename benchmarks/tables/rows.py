"""Rows of result files, as tables take them."""

from __future__ import annotations

from typing import Any

from benchmarks.common.markdown import Document, number

Row = dict[str, Any]


def pick(document: Document, key: str, value: str) -> Row | None:
    """The first row whose `key` has this value."""
    return next((row for row in document["rows"] if row[key] == value), None)


def cell_of(document: Document, what: str, key: str = "median") -> str:
    """A number of a row; empty where there is none."""
    row = pick(document, "what", what)
    return number(row[key]) if row is not None and key in row else ""


def rows_of(documents: tuple[Document, ...]) -> list[Row]:
    """All rows."""
    return [row for document in documents for row in document["rows"]]
