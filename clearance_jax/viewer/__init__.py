"""The viewer: one HTML file that shows a motion, from a dataset."""
