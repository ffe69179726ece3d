"""Fast tiers of `brdfcore.models`."""
