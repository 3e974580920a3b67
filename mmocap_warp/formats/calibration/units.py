"""Units that a calibration's lengths may have."""

METRES = {"m": 1.0, "mm": 0.001}
"""Metres per unit of length."""
