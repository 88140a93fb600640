"""The folder of a car: written from a template, and checked together with the machine."""
