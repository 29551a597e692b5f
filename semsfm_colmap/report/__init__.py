"""The numbers of a reconstruction, their figures, and the self-contained HTML page."""
