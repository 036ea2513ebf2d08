"""Readers of MJCF files."""
