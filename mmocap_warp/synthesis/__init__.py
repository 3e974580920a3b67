"""Made-up recordings with known truth: people who move, cameras around, masks with the faults of real ones.

May import: body, views, result, formats, bodies.
"""
