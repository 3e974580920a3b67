"""The shipped bodies: found by name, and made from MakeHuman's data.

May import: body, formats.
"""
