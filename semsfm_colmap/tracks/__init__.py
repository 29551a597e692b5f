"""From verified pairs to tracks: the measurement matrix in COO form."""
