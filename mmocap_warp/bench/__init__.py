"""How fast the program is: what ``mmocap bench`` measures, with what, and how it is told.

May import: kernels, body, views, result, formats, scene, bodies, objective, optimizers, contour, tracking, drawing.
"""
