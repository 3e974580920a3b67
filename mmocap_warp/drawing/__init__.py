"""Pictures of results: overlays, sheets, plots.

May import: body, views, result, formats, scene, tracking.
"""
