"""Rigged characters and robots of other programs, a file each; ``rigged_mesh`` is what all of them are read as."""
