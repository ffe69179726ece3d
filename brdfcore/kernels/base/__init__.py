"""Compiled counterparts of `brdfcore.base`."""
