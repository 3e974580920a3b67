"""Pages for a browser: one file that needs nothing but itself, and runs nothing but its own code."""
