"""A texture atlas and the images that fill it."""
