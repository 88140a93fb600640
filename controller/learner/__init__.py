"""Estimation while driving: steering offset, understeer, steering delay."""
