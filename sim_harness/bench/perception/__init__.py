"""Benchmarks of the estimators: rendered clips with known truth, real images, closed loop."""
