"""Recipes that come with the package; `tracker.training.recipe_file` finds them."""
