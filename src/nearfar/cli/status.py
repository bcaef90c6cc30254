"""Exit statuses of the command line, beside 0."""

BAD_INPUT = 2
"""Bad input or usage, with one line on the error output."""

FAILED = 3
"""A valid answer that says "not found"."""
