"""What comes in: vehicle, start, goal, obstacles, and what is known of them.

May import mathematics, settings and files. Begin with `models`; `checks` says how the fields must fit together.
"""
