"""Forces that a motion needs: accelerations, the contact of the soles, inverse dynamics, and how uncertain they are."""
