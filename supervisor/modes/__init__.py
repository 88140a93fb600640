"""Modes: causes, timers, transitions, the speed that fear allows."""
