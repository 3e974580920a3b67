"""Answers of tracking, what is known of the truth, and how far they are apart.

May import: body, cameras.
"""
