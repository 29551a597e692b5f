"""One module a format, independent of the others: `write(scene, folder, options)`."""
