"""From poses to vertices."""
