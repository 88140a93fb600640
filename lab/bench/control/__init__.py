"""Benchmarks of the controller on the true lane: ``trepid bench control``."""
