"""What is said where a recording does not determine its cameras."""

from __future__ import annotations


class UnsolvableError(Exception):
    """The recording does not tell where its cameras are; the message says in one line why, and what would help."""
