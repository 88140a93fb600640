"""Rule files tuned over scenarios: ``trepid fear tune``."""
