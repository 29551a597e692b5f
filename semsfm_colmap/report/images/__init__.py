"""The images of the series in the report: a panel an image, a viewer of pairs."""
