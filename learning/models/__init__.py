"""Networks from an image to a road-wheel angle, one file a family; :mod:`learning.models.catalogue` lists them."""
