"""The estimator `tape`: lines of tape of any colour on a floor, as a lane in the plane."""
