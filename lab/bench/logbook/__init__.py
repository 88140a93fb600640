"""Recordings measured: explanations of random moments, opening, crashes, replay."""
