"""What every floor stands on: errors, files, quiet C libraries, compiled functions."""
