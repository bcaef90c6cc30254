"""Cells of tables that people open in a spreadsheet."""

from typing import Any

_FORMULA = "=+-@\t\r"
"""First characters of a text that a spreadsheet takes for a formula."""


def spreadsheet_cell(value: Any) -> str:
    """Return a value as text: empty for None, and a text behind ' where it would be a formula."""
    if value is None:
        return ""
    guarded = isinstance(value, str) and value[:1] and value[0] in _FORMULA
    return f"'{value}" if guarded else str(value)
