"""Mechanisms: bodies, joints of the tree, loops, drives, and parameters by name."""
