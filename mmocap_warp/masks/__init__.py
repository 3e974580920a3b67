"""Which pixels are the subject: masks read or made, cleaned, repaired and judged; observations, the visual hull.

What reads a file raises InputError for one that is missing, damaged or of another kind; a docstring's "Raises" names
what goes beyond that.
"""
