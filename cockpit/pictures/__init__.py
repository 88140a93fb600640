"""Style and files of figures."""
