"""This tree beside another commit: computing times of frames and drives."""
