"""How fast the program is: what ``mmocap bench`` measures, with what, and its report.

May import: kernels, body, cameras, masks, result, formats, scene, rigging, silhouettes, optimizers, contour, tracking,
display.
"""
