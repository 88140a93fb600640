"""RC cars: pulses for servo and speed controller, over a PCA9685 or a serial servo board, and their calibration."""
