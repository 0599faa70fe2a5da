"""The terms of the energy as compiled kernels, on plain arrays, and their sum."""
