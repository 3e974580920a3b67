"""Poses and body from contours, by least squares: a frame, a clip and a body at a time."""

ACCELERATION = 5.4  # standard deviation of a point's acceleration [m/s^2]: 1.5 mm of second difference at 60 frames/s
