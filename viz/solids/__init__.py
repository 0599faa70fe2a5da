"""Drawn shapes of a body: solids of its flesh, or of another URDF's visual shapes."""
