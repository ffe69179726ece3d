"""Zemax tabular BSDF files."""
