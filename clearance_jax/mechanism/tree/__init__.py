"""The tree of joints: elementary coordinates, frames along it, the table of a large one."""
