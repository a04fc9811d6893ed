"""What comes in: vehicle, start, goal, obstacles, and what is known of them.

May import settings, mathematics and files. Begin with `models`; `checks` says how the fields must fit together.
"""
