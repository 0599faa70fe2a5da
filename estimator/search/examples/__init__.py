"""Poses indexed by their appearance: which bits of a picture's description distinguish poses, and a table of them that
is searched without comparing every example."""
