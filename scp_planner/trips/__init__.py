"""Paths along guides and the drive along them: what a trip is, whoever made it.

May import mathematics and settings. Begin with `trajectory`.
"""
