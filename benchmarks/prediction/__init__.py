"""Sharpness and coverage of predicted regions on families of motions and on recordings.

``families`` makes motions, ``recordings`` reads recorded ones, ``measure`` asks a ``Planner`` for its zones and
compares them with the truth.
"""
