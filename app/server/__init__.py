"""The process: its socket, its deadlines, the outermost layer, the log of requests, what is done at the start."""
