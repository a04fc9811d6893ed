"""Paths along guides and the drive along them: what a trip is, whoever made it.

May import mathematics. Begin with `trajectory`; a `space` is what all trips of one problem share.
"""
