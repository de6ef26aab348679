"""Errors of the training's parts, told as bad input: one line, exit code 2."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from tracker.config.errors import ConfigError
from tracker.training.errors import TrainingError
from tracker.weights.errors import WeightsError
from uavfollow.errors import InputError


@contextmanager
def as_bad_input() -> Iterator[None]:
    """Inside, errors of recipes, data, training and weights become InputError."""
    try:
        yield
    except ConfigError as error:
        raise InputError(f"recipe {error}") from error
    except (TrainingError, WeightsError) as error:
        raise InputError(str(error)) from error
