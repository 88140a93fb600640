"""Rule files for people: show, draw, check, convert, document."""
