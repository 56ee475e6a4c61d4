"""A generated capture whose truth is known: static scene, cameras, depth, distractor masks.

Tests, the demo and benchmarks use it; nothing is downloaded. World units are metres, z is up.
Inside this package arrays put coordinates first ("3 N"): numpy is fastest that way.
"""

from __future__ import annotations

from desplat_ns.synthetic.occluders import OccluderSpec
from desplat_ns.synthetic.scene import Frame, Scene, SceneSpec, make_scene, write_scene

__all__ = ["Frame", "OccluderSpec", "Scene", "SceneSpec", "make_scene", "write_scene"]
