"""Poses with what they look like, in any number: what an index of examples is trained on (ELMO section 4)."""
