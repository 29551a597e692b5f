"""Normals, depth maps, fusion, ball pivoting and texture."""
