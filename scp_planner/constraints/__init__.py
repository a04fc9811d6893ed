"""Constraints of a trip, a file each: excess, gradient, rows, tightening.

May import threat zones, trips, the scenario and all below; nothing that solves. Begin with `constraint`, the interface;
`registry` names them all, `setup` is what they are made from.
"""
