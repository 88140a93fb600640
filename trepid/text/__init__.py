"""Text as the tools of all systems write it."""
