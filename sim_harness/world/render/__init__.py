"""Camera frames: ground, scene, light and optics."""
