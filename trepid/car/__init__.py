"""The car: its dimensions and its camera."""
