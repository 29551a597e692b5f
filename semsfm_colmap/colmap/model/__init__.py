"""COLMAP's sparse model and what stands beside it: pinholes, sidecar, points.ply, colours."""
