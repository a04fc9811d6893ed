"""Continuous-time check of a trip, and lower bounds of the travel time.

May import trips, zones and scenarios; never what searches for trips: no solver, no loop, no problem. Begin with
`check`, which says what is checked in which order: `trip_ends`, `limits`, `clearance`, each of a `checked_trip`.
`sampled` is the same for trips that are given by samples.
"""
