"""Input: vehicle, start, goal, obstacles and their observations.

May import mathematics, settings and files. Begin with `models`; `checks` says how the fields must fit together.
"""
