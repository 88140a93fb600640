"""What stands above the ground or in the air: vehicles, backdrop, tunnel, night, rain."""
