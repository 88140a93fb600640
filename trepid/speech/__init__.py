"""What programs say beside their result."""
