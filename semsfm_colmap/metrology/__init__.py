"""Measurement on reconstructed surfaces: sizes with budgets, height maps with areal parameters."""
