"""ASAM OpenMATERIAL 3D reflectance tables."""
