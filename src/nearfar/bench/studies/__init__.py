"""Benchmark studies: what is run on the data and what is reported of it."""
