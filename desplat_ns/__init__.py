"""DeSplat: decomposed Gaussian splatting for distractor-free rendering, as a Nerfstudio method."""

__version__ = "0.1.0"
