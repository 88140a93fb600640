"""Measuring a car before it drives: the parameters of its files."""
