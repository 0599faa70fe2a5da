"""The program in a terminal: tables, progress, commands to paste, interruption."""
