"""The error of this package."""

from __future__ import annotations

from tracker.config.errors import ConfigError


class ScenarioError(ConfigError):
    """A scenario that cannot be used. `problems` holds every finding; the text is one line with the first of them."""
