"""Routes over the ground: the shortest ways round all that stands, one a homotopy class, and loops.

May import zones, trips and scenarios; nothing that plans. Begin with `roadmap`.
"""
