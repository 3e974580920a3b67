"""Made-up recordings with known truth: a person walking, cameras around, masks with the faults of real ones."""
