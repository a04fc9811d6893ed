"""Planning while driving: observe, refresh the zones, replan before a deadline, fall back.

May import planning and all below. Begin with `planner`, which answers; `perception` and `inbox` take what is observed,
`looks` looks at other ways, `fallback` says what is driven where nothing better is found, `evasion` gets out of the
way, `means` is what they share; `safety_gate` decides what may be driven.
"""
