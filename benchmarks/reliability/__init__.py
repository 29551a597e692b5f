"""What may happen to a project, done to a small one again and again, and what came of it."""
