"""Tools for people: explain a drive, show and check a rule file."""
