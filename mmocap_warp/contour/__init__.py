"""Poses and body from contours, by least squares: a frame, a clip and a body at a time.

May import: kernels, device, body, cameras, masks.
"""
