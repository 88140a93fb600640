"""Identification of vehicle parameters from a log."""
