"""The study: a grid of trackers, sequences and budgets, its results, statistics and report.

May import: device, jobs, body, cameras, masks, result, formats, scene, rigging, tracking, fitting, display, synthesis.
"""
