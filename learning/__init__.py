"""Labelled frames to network weights. Needs torch (extra `[train]`)."""
