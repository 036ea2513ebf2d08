"""Readers of scene, study, trajectory and URDF files."""
