"""Faces drawn into the rows of an image."""
