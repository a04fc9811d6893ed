"""Limits that only some scenarios have: each says where it stands and gives its rows.

May import what the room around it may. Begin with `limit`, the interface.
"""
