"""How a crop looks: a plan of random numbers, and two ways to carry it out (OpenCV, and torch on any device).

`plan` (what is done) -> `geometry`, `kernels` (arithmetic of both ways) -> `render`, `effects` (OpenCV, pair by pair)
or `device`, `device_effects`, `jpeg` (torch, a whole batch).
"""
