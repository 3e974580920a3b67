"""What cameras see: the rig, its undistortion, observed masks and their visual hull.

May import: no other room.
"""
