"""Speos (OPTIS) surface files, text: `.anisotropicbsdf` and `.brdf`."""
