"""Sources of skeletons, a file each: one kind of decision.

Begin with `planning.search.Source`. `orders`, `routes` over a map and `gears` decide about the scene; `meeting_times`,
`routes` round what stands, `sides` and `refinements` about one trip.
"""
