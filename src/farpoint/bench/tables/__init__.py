"""The tables of the benchmark. Each table has a small module."""
