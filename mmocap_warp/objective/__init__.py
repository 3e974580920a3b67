"""From candidate poses to costs: posing, silhouettes, counts."""
