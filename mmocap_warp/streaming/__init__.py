"""Live frames in and poses out: images that come while they are recorded, and packets to other programs."""
