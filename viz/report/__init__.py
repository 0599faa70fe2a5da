"""The report of a run: one self-contained page to read, print and send on."""
