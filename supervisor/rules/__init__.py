"""The rule file: sentences, fuzzy sets, inference, proofs, reload."""
