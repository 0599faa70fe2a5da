"""Subjects as text: URDF elements read, checked and rewritten; landmark files; foreign robots."""
