"""Mode seeking in a frame: starts, proposals, kinematic jumps, and the searches of all of them in worker processes."""
