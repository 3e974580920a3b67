"""What the exit code of a command says."""

OK = 0
FAILURE = 1
"""Something broke that is no fault of the input."""
USAGE = 2
"""The command line itself is wrong: :class:`UsageError`."""
BAD_INPUT = 3
"""A file or value that the user can mend: :class:`mmocap_warp.errors.InputError`."""
CHECK_FAILED = 4
"""The command ran, and what it checked does not hold."""
BROKEN_PIPE = 141
"""Whoever was to read the output has closed it, as ``head`` does; nothing is said."""
INTERRUPTED = 130
"""Stopped by Ctrl-C."""
TERMINATED = 143
"""Stopped by SIGTERM, as by a scheduler or a machine that shuts down."""


class Terminated(KeyboardInterrupt):
    """SIGTERM: whatever saves its work on Ctrl-C saves it on this too."""


class UsageError(Exception):
    """A flag's value is wrong, or flags contradict each other."""
