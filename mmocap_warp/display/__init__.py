"""Results to look at: overlays, sheets and plots, and in ``page`` one interactive page for a browser.

May import: body, cameras, result, biomechanics, formats, scene, tracking.
"""
