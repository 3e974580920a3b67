"""A recording as its scene.toml describes it.

May import: views, foreground, formats.
"""
