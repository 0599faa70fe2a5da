"""The functions of the package that users call, and the check of their arguments."""
