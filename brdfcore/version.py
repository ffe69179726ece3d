"""The version of the package: part of every stored table and of every ETag."""

__version__ = "0.1.0"
