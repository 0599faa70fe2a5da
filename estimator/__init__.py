"""How a body is estimated: images, cost, search, filtering, trackers, formats."""
