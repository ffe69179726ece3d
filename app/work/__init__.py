"""What takes long: jobs, pictures and expansions, and the child processes that do them."""
