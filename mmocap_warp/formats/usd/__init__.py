"""USD: bodies, cameras, results and truth as stages."""
