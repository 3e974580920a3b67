"""Answers of tracking, what is known of the truth, and how far they are apart."""

CONFIGURED_LENGTHS = ("smooth", "translation_radius")
"""Settings of a run that are in metres."""
