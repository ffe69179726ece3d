"""The process: its socket, its limits in time, the outermost layer, the log of requests, warming up."""
