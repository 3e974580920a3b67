"""Bodies: the model, its poses, its shapes, and points on its skin."""
