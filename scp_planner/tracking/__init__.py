"""From measurements to estimated motions, and how far predictions can be trusted.

May import scenarios, mathematics and files. Begin with `estimate`; `motion_estimate` has the results.
"""
