"""Bodies: the model, its poses, its shapes, meshes, rotations, and points on its skin."""
