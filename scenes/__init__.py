"""Bodies and scenes that ship with the package, as data files."""

from pathlib import Path

ROOT = Path(__file__).resolve().parent
"""Directory of the shipped data: ``bodies/*.usdc`` (people), ``characters/*.usdc`` and ``<scene>/scene.toml``."""
