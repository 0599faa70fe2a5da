"""The commands, by what they are for: what each takes, and how that is handed to the functions that do the work.

Only light modules are imported at the top of these files: `kinemode --help` must not wait for Pinocchio and numba.
"""
