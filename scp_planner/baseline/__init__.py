"""Penalty descent, the published method, made as well as we can: what others are compared with.

May import planning and all below; nothing online. Begin with `penalty_descent`; `objective` is what it
makes small.
"""
