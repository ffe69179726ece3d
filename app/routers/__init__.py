"""One file a subject; a material's routes are the same by name and by id, made twice by one function."""
