"""Studies of the questions that Deep Steer left open: speed, frame rate, data, image size, light."""
