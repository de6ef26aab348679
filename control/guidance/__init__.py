"""Follow modes: where the vehicle flies with respect to the target. One module each, all pure."""
