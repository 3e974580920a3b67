"""The subject of a recording: its place, heading and pose in the first frame, and its body from the first seconds."""
