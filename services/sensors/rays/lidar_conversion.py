"""Faces drawn into the columns of a spinning LiDAR."""
