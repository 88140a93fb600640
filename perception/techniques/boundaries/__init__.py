"""Stages that turn features into lane boundaries: lines, curves, consensus, Bezier, outliers."""
