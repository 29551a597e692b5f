"""Images, vendor metadata, databar, masks and scale: from a folder of files to a `SemSeries`."""
