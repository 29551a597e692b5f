"""Do the printed error bars hold? Rendered series, mapped and compared with their exact truth."""
