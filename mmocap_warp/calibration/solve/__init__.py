"""Cameras found from nothing but the silhouettes of a person who walks about."""
