"""Readers of the layouts in which tracking benchmarks come."""

from tracker.benchmark.readers.detect import find_sequences

__all__ = ["find_sequences"]
