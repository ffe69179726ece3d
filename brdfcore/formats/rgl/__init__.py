"""RGL .bsdf files."""
