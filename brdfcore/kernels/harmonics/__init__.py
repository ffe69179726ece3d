"""Sums of `brdfcore.harmonics`."""
