"""A line for the user on standard error, which may be closed or dead: no reason to lose what is being done."""

from __future__ import annotations

import sys
from contextlib import suppress


def tell(text: str) -> None:
    """Print on standard error where somebody can read it; never raises."""
    if sys.stderr is None:  # closed by the shell (2>&-); print() would take standard output in its place
        return
    # The terminal is gone; standard error is closed; a signal came in the middle of another line.
    with suppress(OSError, ValueError, RuntimeError):
        print(text, file=sys.stderr, flush=True)
