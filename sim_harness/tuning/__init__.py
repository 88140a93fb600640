"""Optimisation of rule files over scenarios: ``trepid fear tune``."""
