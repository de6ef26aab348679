"""Weights and their cards: the embedded ones, files of the user's, and official checkpoints to import."""
