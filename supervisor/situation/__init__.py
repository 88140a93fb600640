"""The situation at one moment: estimates fused, features measured."""
