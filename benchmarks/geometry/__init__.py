"""The geometry at its limit: the tables of docs/benchmark_geometry.md, one module a table."""
