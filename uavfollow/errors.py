"""The application's errors and exit codes."""

from __future__ import annotations

EXIT_DONE = 0
EXIT_SHORT = 1  # ran and fell short
EXIT_BAD_INPUT = 2
EXIT_INTERRUPTED = 130


class InputError(ValueError):
    """Something that the user gave cannot be used. One line: what, where, and what to do."""
