"""Cameras and views: what is in view, who looks at the same, where a scene begins."""
