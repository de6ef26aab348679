"""How a crop looks: a plan of random numbers, and two ways to carry it out (OpenCV, and torch on any device)."""
