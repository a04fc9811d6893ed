"""Splines, ellipses, outlines, curves: nothing here knows of vehicles or scenarios.

May import arrays and errors alone. Begin with `polynomials` and `splines`.
"""
