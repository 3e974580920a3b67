"""From vertices and masks to counts and costs."""
