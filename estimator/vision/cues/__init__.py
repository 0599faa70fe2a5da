"""Image cues, and points of the body with image features assigned to them. Each cue has a folder."""
