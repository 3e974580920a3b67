"""Calibration from the person: which camera is wrong, cameras made better or found from nothing, and their times.

May import: kernels, body, views, foreground, result, formats, scene, bodies, objective, contour, tracking.
"""
