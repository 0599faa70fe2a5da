"""Shape of a body: flesh, solids, surface nodes and their derivatives."""
