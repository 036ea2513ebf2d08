"""Reads study files, with a module for each of their sections."""
