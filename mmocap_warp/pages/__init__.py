"""What the pages for a browser have in common: one file that needs nothing but itself, and runs nothing but its own.

May import: no other room.
"""
