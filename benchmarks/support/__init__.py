"""Shared parts of several measures: data folders, clips, kept pieces of long measures, scores, timed tracks,
figures."""
