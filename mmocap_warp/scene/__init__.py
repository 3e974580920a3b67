"""A recording as its scene.toml describes it."""
