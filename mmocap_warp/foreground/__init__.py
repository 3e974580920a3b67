"""Which pixels are the subject: reading masks, subtracting the background, cleaning and repairing the result.

May import: views.
"""
