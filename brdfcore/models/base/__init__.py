"""What models share: their class, Fresnel reflectance, microfacets, optical constants."""
