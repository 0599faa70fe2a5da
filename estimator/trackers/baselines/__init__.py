"""Baselines for CSS and ELMO: one mode, several without sampling, CONDENSATION, the annealed particle filter."""
