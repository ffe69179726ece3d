"""Directions of a request as arrays, and values as an answer."""
