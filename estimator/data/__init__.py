"""What comes in: cameras, media, file formats, calibration boards, several people and the clocks of several cameras;
`Observation`, one instant of a clip as trackers see it, and `ImageCues`, what was read of its pictures."""
