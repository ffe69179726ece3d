"""Benchmarks: `python -m tests.benchmarks.NAME`. They print accuracy beside speed and assert neither."""
