"""From hypotheses to the modes of a frame: starts, the energy that is searched in, and searches."""
