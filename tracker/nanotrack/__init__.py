"""NanoTrack V3 (HonglinChu/SiamTrackers on GitHub) from the user's own ONNX files: a second tracker to compare with."""
