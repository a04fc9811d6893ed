"""A scenario made ready for planning: splines, limits, zones and end conditions in the planning frame.

May import the certificate's words and all below; nothing that solves. Begin with `problem`, then `build`.
"""
