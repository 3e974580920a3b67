"""Trackers: configuration, algorithms, frames in turn, checkpoints, the first-frame fit.

May import: kernels, body, views, result, formats, scene, bodies, objective, optimizers, contour.
"""
