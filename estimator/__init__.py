"""Estimation of a body: pictures, energies, searches, trackers, results. Eleven packages, the lowest first, in
`docs/design.md`."""
