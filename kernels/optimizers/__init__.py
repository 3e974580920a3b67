"""Populations: how each optimizer samples and learns."""
