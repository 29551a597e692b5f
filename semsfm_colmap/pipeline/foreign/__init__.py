"""COLMAP databases that somebody else filled: mapped as they are, or brought into a project."""
