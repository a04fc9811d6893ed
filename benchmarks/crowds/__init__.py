"""Among people, by the protocols that others publish: crossings of circles and squares, an arena, recorded crowds."""
