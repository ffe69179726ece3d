"""Tests of tables taken elsewhere."""
