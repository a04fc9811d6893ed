"""Rounding that zones allow for."""

DIRECTION_DECIMALS = 10  # of a heading's vector, which is of about length 1
NO_DIRECTION = 1e-280  # m2; a point so near to a centre has no direction from it
SAME_CONTACT = 1e-8  # units of length, and of normals: contacts that differ by less are one but for rounding
FLATTEST = 1e-9  # share of a covariance's trace that its determinant's root is at least taken for
LEVEL = 1e-9  # of a direction across the guide: less is none
TUBE_TOLERANCE = 1e-9  # relative: speeds and lateral accelerations above those recorded by no more are not refused
