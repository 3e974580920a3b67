"""Cameras found from videos of a chessboard or a ChArUco board of known size."""
