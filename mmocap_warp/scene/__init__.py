"""A recording as its scene.toml describes it.

May import: device, cameras, masks, formats.
"""
