"""How probable it is that a candidate is the target: features, the target's own reference, a fitted model."""
