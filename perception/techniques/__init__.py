"""The techniques of the review, each one pure function, and the pipelines that are built from them."""
