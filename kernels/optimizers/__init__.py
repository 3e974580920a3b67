"""Populations: how each optimizer draws and learns."""
