"""Independent reference solutions; nothing in here imports clearance_jax."""
