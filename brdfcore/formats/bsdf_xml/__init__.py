"""BSDF files of WINDOW and Radiance (XML): Klems matrices and tensor trees."""
