"""Rows of the linearised constraints, with labels.

May import the problem and all below. Begin with `base`.
"""
