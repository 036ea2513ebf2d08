"""Inverse kinematics: the posture of the ideal mechanism for a point's pose or path."""
