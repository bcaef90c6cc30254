"""A report of benchmark results: one self-contained page, LaTeX tables, and the rows as tables.

Its modules need the packages of the extra `bench`.
"""
