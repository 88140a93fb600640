"""Files without meaning of their own: text in any encoding, and what is computed once and kept for a user."""
