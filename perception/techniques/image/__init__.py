"""Stages that turn pictures into pictures: colour, light, smoothing, shadows, regions, warps, edges, stripes."""
