"""What a body is drawn as: solids of its flesh, or of a foreign URDF's visual shapes."""
