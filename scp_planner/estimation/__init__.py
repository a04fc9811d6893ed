"""From observations to estimated motions, and how far they can be trusted.

May import scenarios, mathematics and files. Begin with `estimate`; `motion_estimate` is what comes out.
"""
