"""Friction laws; a joint without friction has none of them."""
