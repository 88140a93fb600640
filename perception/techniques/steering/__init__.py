"""Stages that turn boundaries into a lane state, follow it from frame to frame, or steer by a printed rule."""
