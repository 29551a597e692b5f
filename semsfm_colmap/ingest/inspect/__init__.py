"""A look at a series without preparing it: rows, neighbours, a verdict."""
