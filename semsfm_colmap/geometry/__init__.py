"""Orthographic projection, rotations, affine epipolar geometry, alignment: plain numpy."""
