"""Calibrations, a file each: cameras of other programs as a CameraRig; ``formats/table.py`` lists them."""
