"""How the specimen turned: one axis, known tilts as a prior, known against seen."""
