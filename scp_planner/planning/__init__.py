"""One plan for one scenario, and why there is none.

May import the search, the loop and all below. Begin with `offline`; `plan` is what comes out.
"""
