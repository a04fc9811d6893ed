"""From measurements to estimated motions, and how far predictions can be trusted.

May import scenarios, mathematics and files. Begin with `maximum_likelihood`, or with `kalman` for motions with noise of
their own; `motion_estimate` has the results.
"""
