"""Stages that turn boundaries into a lane state or a steering angle: the printed steering rules."""
