"""What CSS and ELMO are compared with: one mode, several without sampling, CONDENSATION, the annealed particle
filter."""
