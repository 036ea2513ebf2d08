"""The two forms of the dynamics, written out or over a table, behind one interface."""
