"""Depth maps by plane sweep under parallel rays."""
