"""One module a stage: load what the one before left, call, save; nothing else."""
