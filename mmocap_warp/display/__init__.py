"""Results to look at: overlays, sheets and plots, and in ``page`` one interactive page for a browser.

What writes a file raises InputError for a name of another ending or a folder that cannot be written to.
"""
