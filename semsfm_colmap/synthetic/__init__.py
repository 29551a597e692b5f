"""Scenes and an SEM-like renderer with exact truth."""
