"""Where a study's cells are tracked: processes of this machine, or a Ray cluster."""
