"""Damaged files, killed runs, files that disagree, and changes of the code that must change no bit."""
