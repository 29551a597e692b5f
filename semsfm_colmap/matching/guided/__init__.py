"""Second pass with a model at hand: every point is looked for in every image that should see it."""
