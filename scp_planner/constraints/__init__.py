"""What a trip has to keep: of each constraint, in one file, the excess of a trip and how a step changes it.

May import threat zones, trips, the scenario and all below; nothing that solves. Begin with `constraint`, the interface;
`registry` names them all, `setup` is what they are made from.
"""
