"""Reads URDF files as mechanisms of robots."""
