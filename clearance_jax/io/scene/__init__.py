"""Reads scene files as mechanisms."""
