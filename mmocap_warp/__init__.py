"""Silhouette-based markerless motion capture on NVIDIA Warp and OpenUSD."""

__version__ = "0.1.0"
