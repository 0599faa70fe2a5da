"""The person's outline against a known background."""
