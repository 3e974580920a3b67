"""Cameras and body as one least-squares problem over the outlines, for checking and refining."""
