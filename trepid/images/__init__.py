"""Image files, and images made upright."""
