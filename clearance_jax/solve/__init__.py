"""The solve: a motion and its variations, error control with contacts, events, samples."""
