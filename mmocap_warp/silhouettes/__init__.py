"""From candidate poses to costs: posing, silhouettes, counts."""

COSTS = ("paper", "xor", "iou")
"""The named costs; ``paper`` is Eq. 4-5. ``kernels/silhouettes/cost.py`` has a constant of each name."""

RENDERERS = ("raycast", "raster")
"""How silhouettes are drawn; the counts are the same."""
