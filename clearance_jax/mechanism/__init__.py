"""Mechanisms: bodies, joints of the tree, loops, drives, and the layout of their states."""
