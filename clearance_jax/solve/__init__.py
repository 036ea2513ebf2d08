"""The solve: a motion and its variations, error control that contact cannot fool, events, samples."""
