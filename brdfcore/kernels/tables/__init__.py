"""Look-ups of `brdfcore.tables`."""
