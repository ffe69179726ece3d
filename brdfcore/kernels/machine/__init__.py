"""What kernels are made with: compile, launch on one core or all, vectors, elementary functions."""
