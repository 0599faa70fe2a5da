"""What a user sees of the program in a terminal: tables, progress, commands to paste, interruption."""
