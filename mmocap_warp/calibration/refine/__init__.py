"""Cameras made better from the person, where held-out frames agree that they are."""
