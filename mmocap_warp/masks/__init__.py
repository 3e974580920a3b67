"""Which pixels are the subject: masks read or made, cleaned, repaired and judged; observations, the visual hull.

May import: kernels, cameras.
"""
