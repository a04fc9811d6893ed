"""Planning while driving: observe, refresh the zones, replan before a deadline, fall back.

May import planning and all below. Begin with `planner`; `vetting` decides what may be driven.
"""
