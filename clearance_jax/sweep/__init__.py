"""Sweeps: one question, any number of answers, as one labelled dataset."""
