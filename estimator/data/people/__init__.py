"""Which of several people in several cameras is the subject, and which detections are of one person."""
