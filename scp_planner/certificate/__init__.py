"""Whether a trip is safe, at all times and not only at samples; and how fast any trip can be at most.

May import trips, zones and scenarios; never what searches for trips: no solver, no loop, no problem. Begin with
`check`.
"""
