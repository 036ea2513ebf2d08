"""What is asked of a mechanism at points, and the answers: alone, as lanes, or on a cluster."""
