"""Closed loops: sensors, a world that moves, a vehicle that follows, and what is written down.

May import online and all below. Begin with `loop`.
"""
