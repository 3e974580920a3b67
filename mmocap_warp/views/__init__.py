"""What cameras see: the rig, its undistortion, observed masks and their visual hull."""
