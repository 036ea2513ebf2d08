"""Independent reference solutions; nothing in here imports clearance_jax, but `laws_today` (a record of it)."""
