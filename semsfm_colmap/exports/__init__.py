"""What other programs read: one module a format in formats/, a registry, what formats share."""
