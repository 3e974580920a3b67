"""From candidate poses to costs: posing, silhouettes, counts.

May import: kernels, device, body, cameras, masks.
"""
