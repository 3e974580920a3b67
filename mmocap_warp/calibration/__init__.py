"""Calibration from the person: which camera is wrong, cameras made better or found from nothing, and their times."""
