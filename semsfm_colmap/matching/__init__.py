"""Which pairs to match, affine verification and the paper's filters."""
