"""Gradients by the weights of a network in a friction law (see `__main__`)."""
