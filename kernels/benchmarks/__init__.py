"""Micro-benchmarks of the kernels: how they are timed, and each kernel alone.

Unlike the kernels themselves, they know the rest of the project: a kernel is timed on the arrays that a tracker gives
it. ``mmocap bench`` runs them.
"""
