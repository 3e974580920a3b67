"""Results to look at interactively: one page for a browser.

May import: pages, body, views, result, formats, scene, tracking, drawing.
"""
