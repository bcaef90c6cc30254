"""A report of benchmark results: one self-contained page, LaTeX tables, and the rows as tables.

Everything but `requirements` needs the optional dependencies of `nearfar[report]`.
"""
