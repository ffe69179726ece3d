"""Scattered measurements as rows of numbers, by columns."""
