"""What a body looks like: flesh, solids, surface nodes and their derivatives."""
