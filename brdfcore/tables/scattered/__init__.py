"""Measurements at scattered pairs of directions, regridded."""
