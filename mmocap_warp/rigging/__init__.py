"""The shipped bodies, found by name; bodies of other programs are made by the subroom ``importing``."""
