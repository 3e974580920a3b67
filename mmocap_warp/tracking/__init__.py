"""Trackers: settings, algorithms, frames in turn, checkpoints, the clip smoothed, live."""
