"""The laboratory, above all other packages: benchmarks of the parts beside their peers."""
