"""Runs as files for programs that show bodies: glTF, rerun."""
