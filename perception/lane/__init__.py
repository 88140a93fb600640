"""The computer-vision lane estimator `cv`: points, search, fit, memory, road edges, evidence, confidence."""
