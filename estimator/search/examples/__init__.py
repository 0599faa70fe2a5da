"""Poses known by what they look like: which bits of a picture's description tell poses apart, and a table of them that
is searched without looking at every example."""
