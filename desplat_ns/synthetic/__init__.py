"""A generated capture whose truth is known: static scene, cameras, depth, distractor masks.

With daylight also each photo's light and sky. Tests, the demo and benchmarks use it; nothing is
downloaded. World units are metres, z is up.
Inside this package arrays put coordinates first ("3 N"): numpy is fastest that way.

May import `data` and `errors`.
"""

from __future__ import annotations

from desplat_ns.synthetic.daylight import Daylight, DaylightSpec
from desplat_ns.synthetic.layouts import write_scene
from desplat_ns.synthetic.light import Light, apply_light
from desplat_ns.synthetic.occluders import OccluderSpec
from desplat_ns.synthetic.scene import Frame, Scene, make_scene
from desplat_ns.synthetic.sky import Sky
from desplat_ns.synthetic.spec import SceneSpec

__all__ = [
    "Daylight",
    "DaylightSpec",
    "Frame",
    "Light",
    "OccluderSpec",
    "Scene",
    "SceneSpec",
    "Sky",
    "apply_light",
    "make_scene",
    "write_scene",
]
