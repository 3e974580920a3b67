"""What cameras see of a body in motion: silhouettes, shadows, and masks with the faults of real ones."""
