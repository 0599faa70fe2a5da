"""What several measures share: data folders, clips, kept pieces of long measures, scores, timed tracks, figures."""
