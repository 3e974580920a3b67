"""Calibrated cameras: the rig, its lenses, undistortion, and pictures of projected meshes."""
