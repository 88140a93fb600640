"""Tables of text (CSV) in all their dialects."""
