"""What other programs read: one module a format, a registry, names and pinhole cameras shared."""
