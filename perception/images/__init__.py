"""Images from files, and pictures of what an estimator found."""
