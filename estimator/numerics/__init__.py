"""Numbers alone: knows neither body nor image."""
