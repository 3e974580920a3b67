"""Trackers: settings, algorithms, frames in turn, checkpoints, the clip smoothed, live.

May import: kernels, device, body, cameras, masks, result, formats, scene, rigging, silhouettes, optimizers, contour.
"""
