"""DeSplat: decomposed Gaussian splatting for distractor-free rendering, as a Nerfstudio method."""

import warnings

__version__ = "0.1.0"

# What torch and nerfstudio have to change, users cannot; `-W` still shows it.
warnings.filterwarnings("ignore", "", FutureWarning, r"(torch|nerfstudio)\.", append=True)
