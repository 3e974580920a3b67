"""The study: a grid of trackers, sequences and budgets, its results, statistics and report."""
