"""One frame: what its file holds, which part of it is image, how good it is."""
