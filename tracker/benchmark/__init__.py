"""Scores of a track against ground truth."""
