"""Speed against error: every representation of a material, built, measured and compared."""
