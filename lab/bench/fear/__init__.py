"""Benchmarks of the supervisor: inference, causes, fuzzed messages, supervised drives."""
