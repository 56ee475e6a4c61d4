"""Pictures as files."""

from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, UInt8
from PIL import Image


def write_image(
    path: Path,
    image: UInt8[np.ndarray, "H W *C"] | Bool[np.ndarray, "H W *C"] | Float[np.ndarray, "H W *C"],
) -> None:
    """Write a picture in the format that the file name asks for; makes missing folders.

    Booleans become 0 and 255; floats in [0, 1] are rounded to 8 bits.
    """
    values = np.nan_to_num(image.astype(np.float32)).clip(0, 1) * 255
    pixels = image if image.dtype == np.uint8 else np.rint(values).astype(np.uint8)
    path.parent.mkdir(parents=True, exist_ok=True)
    is_grey = pixels.ndim == 3 and pixels.shape[2] == 1
    Image.fromarray(pixels[..., 0] if is_grey else pixels).save(path, quality=98)
