"""The energy of a configuration: `Term`, one file a term, and their sum, `Cost`; `descent` lowers it within limits."""
