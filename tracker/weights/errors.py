"""The one error of this package."""

from __future__ import annotations


class WeightsError(ValueError):
    """Weights that are missing, foreign or broken. The message says which file, what is wrong and what to do."""
