"""What `gradient_report` is worth: how far the predicted horizon is off, and how often the verdict is wrong."""
