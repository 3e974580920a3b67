"""Published data sets, from a user's own copy: a file each, which reads one recording as a scene."""
