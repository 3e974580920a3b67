"""How kernels are timed, and what a timed work and its check are; nothing here knows what is timed."""
