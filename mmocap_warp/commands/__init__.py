"""One function for each command: it takes objects or paths, does all of the work, and gives back what it made.

The command line parses, calls one of these functions and prints; ``import mmocap_warp as mm`` has the same functions.
"""
