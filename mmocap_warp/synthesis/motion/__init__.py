"""Motions as full pose vectors of a body: those that ship, those through key poses, those of clips; knows no camera."""
