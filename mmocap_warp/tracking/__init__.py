"""Trackers: configuration, algorithms, frames in turn, checkpoints, the first-frame fit."""
