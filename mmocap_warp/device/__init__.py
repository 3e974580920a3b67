"""Where work runs: the chosen device, CPU threads, copies to and from a GPU, replays of captured graphs."""
