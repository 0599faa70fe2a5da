"""Estimation of a body: pictures, energies, searches, trackers, results. Ten packages, the lowest first, in
`docs/design.md`."""
