"""Gloss and haze as instruments measure them."""
