"""What every module may need: the base of modules, array types, elementary functions, small matrices, names with stars,
optional packages.
"""
