"""Sweeps: many cases on many processes or machines, their results kept as they finish."""
