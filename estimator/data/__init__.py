"""Input: cameras, media, file formats, calibration boards, several people and the clocks of several cameras;
`Observation`, one instant of a clip as trackers see it, and `ImageCues`, the cues read from its pictures."""
