"""The computer-vision lane estimator `cv`: candidates in one frame, choice, memory, estimate."""
