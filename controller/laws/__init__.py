"""Lateral control laws: lane to path curvature."""
