"""How fast the program is: what ``mmocap bench`` measures, with what, and its report.

May import: kernels, body, cameras, masks, formats, rigging, silhouettes, optimizers, contour, tracking, display.
"""
