"""From the world into images."""
