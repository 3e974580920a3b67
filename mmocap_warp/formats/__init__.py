"""Outside formats, a file or a subroom each; they know no tracker.

Every reader raises InputError for a file that is missing, damaged or of another kind, and every writer for a name of
another ending or a folder that cannot be written to. A docstring's "Raises" names what goes beyond that.
"""
