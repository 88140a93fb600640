"""Images from files, and pictures of estimates."""
