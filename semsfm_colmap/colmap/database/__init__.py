"""COLMAP's database: our working store, another's to read, checks, the schema of 3.8."""
