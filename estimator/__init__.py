"""How a body is estimated: pictures, energies, searches, trackers, results. `docs/design.md` has the floors."""
