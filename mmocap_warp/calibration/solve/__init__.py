"""Cameras found from nothing but the silhouettes of a person who walks about."""


class UnsolvableError(Exception):
    """The recording does not determine its cameras; the message says in one line why, and what would help."""
