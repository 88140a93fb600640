"""Benchmarks of the estimators: rendered clips with known truth, closed loop."""
