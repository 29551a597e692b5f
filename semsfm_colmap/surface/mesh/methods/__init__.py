"""Meshers: one module a method, a registry, and what every one of them is handed."""
