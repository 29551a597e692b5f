"""The 3-D viewer: what it shows as packed arrays, and the page around it."""
