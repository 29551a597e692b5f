"""Triangulation, graduated filtering, bundle adjustment, covariance, depth reversal."""
