"""From cameras to views and from rendered layers to images. May import `backend`."""
