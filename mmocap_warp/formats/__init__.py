"""Outside formats, a file or a subroom each; they know no tracker.

May import: body, cameras, masks, result.
"""
