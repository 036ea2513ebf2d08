"""Labelled datasets of solutions, and their files."""
