"""The tables of docs/: what they are made with, one module (or folder of modules) a table.

Run from the repository: ``python -m benchmarks.geometry``, ``python -m benchmarks.guided``, each
with ``--help``. `tables` writes them into the pages, between markers that name the command.

The package is for those who change the program; it is not in the wheel.
"""
