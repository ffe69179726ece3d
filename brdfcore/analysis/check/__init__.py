"""Is a material physically possible, and what would make it so."""
