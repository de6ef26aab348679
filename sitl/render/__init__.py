"""From the world and a camera pose to a picture and its truth."""
