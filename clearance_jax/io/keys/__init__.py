"""The keys of scene and study files, each declared once for the readers and the reference."""
