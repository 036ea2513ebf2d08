"""The vector field: kinematics, equations of motion, closures, energies, observables."""
