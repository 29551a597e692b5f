"""Studies of the method on a series, beside the pipeline."""
