"""The one error of this package."""

from __future__ import annotations


class TrainingError(ValueError):
    """Data, recipe or run that cannot be used. The message says which, what is wrong and what to do."""
