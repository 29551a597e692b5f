"""Triangles from an oriented cloud: ball pivoting, repair, pictures of them."""
