"""The ``mmocap`` command line."""
