"""Support for all packages: errors, files, quiet C libraries, compiled functions."""
