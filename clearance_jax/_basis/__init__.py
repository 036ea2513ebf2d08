"""What every module may need: modules, array types, elementary functions, roots, matrices, names with stars."""
