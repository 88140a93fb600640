"""A run in one process: the nodes of the simulator, the loop, the trace and its scores."""
