"""Benchmarks of processes over Zenoh: the way of a frame through the pipeline, bare Zenoh, overload; faults."""
