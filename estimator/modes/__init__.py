"""Modes and mixtures of them: where they came from, when two are the same, the best path through many."""
