"""What is computed once and kept in a folder of the user."""
