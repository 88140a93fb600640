"""How well the controller's laws keep a lane that they see exactly, side by side: ``trepid bench control``."""
