"""Rasterizers behind one protocol. `resolve` picks one; each is imported only when asked for."""

from desplat_ns.backend.protocol import Rasterizer, Rendering, RenderSettings, Splats, View
from desplat_ns.backend.registry import BackendName, resolve

__all__ = ["BackendName", "Rasterizer", "RenderSettings", "Rendering", "Splats", "View", "resolve"]
