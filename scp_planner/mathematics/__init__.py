"""Splines, ellipses, outlines, curves: nothing here knows of vehicles or scenarios.

May import nothing of the package but arrays and errors. Begin with `polynomials` and `splines`.
"""
