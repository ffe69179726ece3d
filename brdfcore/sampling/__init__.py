"""Directions drawn for any material, and the density that they are drawn with."""
