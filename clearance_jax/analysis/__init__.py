"""What is asked of a motion: signals, metrics, derivatives by name, limit cycles, trust."""
