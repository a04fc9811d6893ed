"""Limits that only some scenarios have: each says where it stands and gives its rows.

May import trips, zones and mathematics. Begin with `limit`, the interface.
"""
