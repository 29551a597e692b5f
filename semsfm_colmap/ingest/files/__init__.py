"""Image files: found, their headers checked, their pixels read and written."""
