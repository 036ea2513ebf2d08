"""Runs on disk, which a killed process goes on with: the question in words, lock, journal, partial results."""
