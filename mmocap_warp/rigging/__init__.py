"""The shipped bodies: found by name, and made from MakeHuman's data; others are made by the subroom ``importing``.

May import: body, formats.
"""
