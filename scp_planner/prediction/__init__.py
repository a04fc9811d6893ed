"""Zones of tracked obstacles: what is known of each obstacle, and where it may be from now on.

May import threat zones and all below. Begin with `obstacle_tracks`; `track` holds one obstacle, `sensor_frames` takes
in measurements of many, and `foresight` derives zones predicted with future measurements.
"""
