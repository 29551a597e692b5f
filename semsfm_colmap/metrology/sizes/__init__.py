"""Sizes of the surface: places, features, fits, and their uncertainty budgets."""
