"""The car among people, cyclists and animals, and the detector of people on drawn and on real pictures."""
