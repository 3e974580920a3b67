"""Bodies of other programs' characters and robots: brought into a body's axes, given freedom, and closed for tracking.

``imported`` is the door; the others are its steps and know nothing of each other but ``joint_tree``.
"""
