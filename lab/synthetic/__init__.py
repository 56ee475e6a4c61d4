"""A generated capture whose truth is known: static scene, cameras, depth, distractor masks.

With daylight also each photo's light and sky. Tests, the demo and studies use it; nothing is
downloaded. World units are metres, z is up.
Inside this package arrays put coordinates first ("3 N"): numpy is fastest that way.
"""

from lab.synthetic.daylight import DaylightSpec
from lab.synthetic.layouts import write_scene
from lab.synthetic.occluders import OccluderSpec
from lab.synthetic.scene import Frame, Scene, make_scene
from lab.synthetic.spec import SceneSpec

__all__ = [
    "DaylightSpec",
    "Frame",
    "OccluderSpec",
    "Scene",
    "SceneSpec",
    "make_scene",
    "write_scene",
]
