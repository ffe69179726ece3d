"""Spherical harmonics: Legendre functions, expansions of BRDFs with a stated error, windows."""
