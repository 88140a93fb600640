"""The lane model: state vector, fit, prior, prediction, score and probability of a lane."""
