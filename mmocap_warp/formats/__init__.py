"""One file per outside format; nothing here is needed to evaluate a pose."""
