"""The HTTP service over `brdfcore`: it checks, looks up, encodes and caches; the mathematics is in the library."""
