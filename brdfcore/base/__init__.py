"""What all else stands on: conventions, errors, geometry, quadrature, parameters, names, and what a `Brdf` is."""
