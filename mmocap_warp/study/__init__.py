"""The study: a grid of trackers, sequences and budgets, its results, statistics and report.

May import: pages, body, views, foreground, result, formats, scene, bodies, contour, tracking, calibration, drawing,
synthesis.
"""
