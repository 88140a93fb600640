"""What every estimator of the lane is worth: on rendered clips with known truth, on real pictures, at the wheel."""
