"""Tools for rule files: show, draw, check, convert, document."""
