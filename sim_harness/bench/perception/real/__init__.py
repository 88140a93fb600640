"""Benchmarks of the estimators on labelled real images."""
