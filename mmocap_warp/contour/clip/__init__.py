"""A clip as one problem: contours of all frames, a penalty on accelerations, the second opinion, deviations."""
