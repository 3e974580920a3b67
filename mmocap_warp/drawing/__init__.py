"""Pictures of results: overlays, sheets, plots.

May import: body, views, result, measures, formats, scene, tracking.
"""
