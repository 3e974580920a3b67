"""A result's best run as other programs read it, a file a format; USD, which is also read, has a room of its own."""
