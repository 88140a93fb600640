"""Estimators and the supervisor on the real sets, drive by drive, beside trivial baselines."""
