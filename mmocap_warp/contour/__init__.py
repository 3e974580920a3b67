"""Poses, the body and a clip's motion by least squares on outlines: what the paper's search begins, it finishes.

May import: kernels, body, views.
"""
