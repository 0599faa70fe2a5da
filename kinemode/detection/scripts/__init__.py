"""Programs that environments of their own run as files: they use what their first lines pin, nothing of kinemode."""
