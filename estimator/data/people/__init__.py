"""Which of several people in several cameras is the subject; who everybody is."""
