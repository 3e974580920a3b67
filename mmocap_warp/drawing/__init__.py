"""Pictures of results: overlays, sheets, plots."""
